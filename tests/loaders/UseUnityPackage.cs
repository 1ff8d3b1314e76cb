// What Unity does with the package's sample, and what a program may do wrong with TissueForce; prints what came of it.
using System;
using System.Globalization;
using System.IO;
using System.Reflection;
using System.Runtime.InteropServices;
using Lumbar;
using UnityEngine;

static class UseUnityPackage
{
    const BindingFlags Hidden = BindingFlags.Instance | BindingFlags.Static | BindingFlags.NonPublic;

    static void Refused(string what, Action action)
    {
        try
        {
            action();
            Print(what, "nothing");
        }
        catch (Exception error)
        {
            Print(what, error.GetType().Name + ": " + error.Message.Split('\n')[0]);
        }
    }

    static void Print(params object[] items)
    {
        Console.WriteLine(string.Join(" ", Array.ConvertAll(items, item => string.Format(CultureInfo.InvariantCulture, "{0:G17}", item))));
    }

    static void Call(object target, string message)
    {
        target.GetType().GetMethod(message, Hidden).Invoke(target, null);
    }

    static void Main(string[] arguments)
    {
        CultureInfo.CurrentCulture = new CultureInfo("de-DE"); // numbers of files have points all the same
        Application.streamingAssetsPath = arguments[0];
        var library = arguments[1];
        var folder = Path.Combine(arguments[0], "KB");

        var callback = typeof(TissueForce).GetMethod("Logged", Hidden);
        Print("callback", callback.IsStatic, callback.GetCustomAttribute<AOT.MonoPInvokeCallbackAttribute>() != null);

        var tool = new Rigidbody();
        var sample = new PushOnTissue();
        foreach (var field in new[] { Tuple.Create("surface", (object)new Transform()), Tuple.Create("tool", (object)tool) })
            typeof(PushOnTissue).GetField(field.Item1, Hidden).SetValue(sample, field.Item2);
        Call(sample, "OnEnable");
        for (var frame = 0; frame < 100; ++frame)
        {
            Time.fixedTimeAsDouble = 3.0 + 0.02 * frame;
            tool.position.y = -0.002f * (float)Math.Sin(0.1 * frame);
            Call(sample, "FixedUpdate");
            Print("frame", (double)tool.position.y, sample.Force, (double)tool.lastForce.y);
        }
        Call(sample, "OnDisable");
        Print("loaded", File.ReadAllText("/proc/self/maps").Contains(library));

        typeof(PushOnTissue).GetField("model", Hidden).SetValue(sample, "space");
        Call(sample, "OnEnable");
        for (var frame = 0; frame < 100; ++frame)
        {
            Time.fixedTimeAsDouble = 3.0 + 0.02 * frame;
            tool.position = new Vector3(0.001f * (float)Math.Cos(0.1 * frame), tool.position.y + 0.0001f, 0.002f);
            Call(sample, "FixedUpdate");
            var p = tool.position;
            var f = tool.lastForce;
            Print("space", p.x, p.y, p.z, f.x, f.y, f.z);
        }
        Call(sample, "OnDisable");
        using (var tissue = new TissueForce(Path.Combine(arguments[0], "space")))
            Refused("several axes", () => tissue.Step(0.0, 0.0));

        using (var tissue = new TissueForce(folder))
        {
            Print("described", tissue.SamplingTime, tissue.InputName, tissue.InputUnit, tissue.OutputName, tissue.OutputUnit,
                tissue.ResistingSign, tissue.Lowest, tissue.Highest, tissue.Speed, tissue.LowestHz, tissue.HighestHz);
            tissue.ForceLimit = 5.0;
            tissue.Gain = 2.0;
            Refused("too much", () => tissue.ForceLimit = 99.0);
            Refused("no parameter", () => tissue.Set("stiffness", 1.0));
            tissue.Step(7.0, 0.0);
            Refused("back", () => tissue.Step(6.0, 0.0));
            Refused("pause", () => tissue.Step(9.0, 0.0));
            tissue.Reset();
            Print("again", tissue.Step(9.0, 0.0), tissue.Step(9.01, 1.0), tissue.Gain, tissue.ForceLimit);
        }
        using (var tissue = new TissueForce(folder, text => Console.WriteLine("log: " + text)))
            Refused("told too much", () => tissue.Gain = 99.0);
        var disposed = new TissueForce(folder);
        disposed.Dispose();
        disposed.Dispose();
        Refused("disposed", () => disposed.Step(0.0, 0.0));
        Refused("FMI 2.0", () => new TissueForce(arguments[2]));
        Refused("no library", () => new TissueForce(arguments[3]));
        Print("loaded", File.ReadAllText("/proc/self/maps").Contains(library));

        double last = double.NaN;
        var count = 0;
        var thread = new HapticThread(folder, () => 1.0, force => { last = force; ++count; });
        System.Threading.SpinWait.SpinUntil(() => count > 100, 20000);
        thread.Dispose();
        Print("thread", count > 100, last, thread.Failure == null);
    }
}
