// The same model on a thread of its own, as a haptic device needs it: 1000 times a second and more, whatever the game does.
using System;
using System.Diagnostics;
using System.Threading;
using Lumbar;

public sealed class HapticThread : IDisposable
{
    readonly TissueForce tissue;
    readonly Func<double> readPosition;  // of the device, in mm, growing into the tissue
    readonly Action<double> sendForce;   // to the device, in N, against the direction in which the position grows
    readonly Thread thread;
    volatile bool running = true;

    /// <summary>What stopped the thread; null while it runs.</summary>
    public Exception Failure { get; private set; }

    public HapticThread(string folder, Func<double> readPosition, Action<double> sendForce)
    {
        tissue = new TissueForce(folder);
        this.readPosition = readPosition;
        this.sendForce = sendForce;
        thread = new Thread(Run) { IsBackground = true, Priority = ThreadPriority.Highest };
        thread.Start();
    }

    void Run()
    {
        var clock = Stopwatch.StartNew();
        try
        {
            while (running)
            {
                sendForce(tissue.Step((double)clock.ElapsedTicks / Stopwatch.Frequency, readPosition()));
                Thread.SpinWait(200); // the device's own call waits for the next tick
            }
        }
        catch (Exception error)
        {
            Failure = error; // such as a pause of the whole program, after which the model must begin anew
        }
        sendForce(0.0); // a device must never keep the last force
    }

    public void Dispose()
    {
        running = false;
        thread.Join();
        tissue.Dispose();
    }
}
