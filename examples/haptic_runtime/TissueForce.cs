// A tissue model in Unity or any .NET program: position in, force of the same sample out, by FMI 3.0.
//
// Unzip <model>_fmi3.fmu into StreamingAssets/<model>. In Unity, make one TissueForce per model in Awake, call
// Step(position) once per sample of the model from the haptic thread, and Dispose it in OnDestroy. Without Unity:
//
//   dotnet run -- KB KB/resources/reference_input.csv      (or: csc TissueForce.cs; TissueForce.exe KB positions.csv)
//
// prints time, position and force of a file of positions, as play_fmu.c does.
using System;
using System.Globalization;
using System.IO;
using System.Runtime.InteropServices;
using System.Xml;

public sealed class TissueForce : IDisposable
{
    const uint Position = 1, Force = 2; // value references, as in modelDescription.xml
    const int Warning = 1;

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    delegate void LogMessage(IntPtr environment, int status, IntPtr category, IntPtr message);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    delegate IntPtr Instantiate(
        [MarshalAs(UnmanagedType.LPStr)] string name, [MarshalAs(UnmanagedType.LPStr)] string token, IntPtr resources,
        [MarshalAs(UnmanagedType.I1)] bool visible, [MarshalAs(UnmanagedType.I1)] bool logging,
        [MarshalAs(UnmanagedType.I1)] bool eventMode, [MarshalAs(UnmanagedType.I1)] bool earlyReturn,
        IntPtr intermediate, UIntPtr intermediateCount, IntPtr environment, LogMessage log, IntPtr update);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    delegate int EnterInitialization(
        IntPtr instance, [MarshalAs(UnmanagedType.I1)] bool toleranceDefined, double tolerance, double start,
        [MarshalAs(UnmanagedType.I1)] bool stopDefined, double stop);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    delegate int Transition(IntPtr instance);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    delegate int UpdateDiscreteStates(
        IntPtr instance, out byte again, out byte ends, out byte nominals, out byte values, out byte defined,
        out double next);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    delegate int DoStep(
        IntPtr instance, double from, double step, [MarshalAs(UnmanagedType.I1)] bool noRollback, out byte eventNeeded,
        out byte ends, out byte early, out double reached);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    delegate int Access(IntPtr instance, ref uint reference, UIntPtr count, ref double value, UIntPtr values);

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    delegate void Free(IntPtr instance);

    readonly LogMessage log = Logged; // kept, so that it is not collected while the FMU holds it
    readonly Transition enterEvent, enterStep, terminate;
    readonly UpdateDiscreteStates update;
    readonly DoStep doStep;
    readonly Access set, get;
    readonly Free free;
    IntPtr instance;
    long samples;

    /// <summary>Seconds between samples: how often Step is to be called.</summary>
    public double SamplingTime { get; }

    public TissueForce(string folder)
    {
        var description = new XmlDocument();
        description.Load(Path.Combine(folder, "modelDescription.xml"));
        var root = description.DocumentElement;
        var simulation = root["CoSimulation"];
        var identifier = simulation.GetAttribute("modelIdentifier");
        SamplingTime = double.Parse(simulation.GetAttribute("fixedInternalStepSize"), CultureInfo.InvariantCulture);
        var library = Native.Open(Path.GetFullPath(Path.Combine(folder, "binaries", Native.Platform, identifier + Native.Suffix)));
        enterEvent = Native.Function<Transition>(library, "fmi3EnterEventMode");
        enterStep = Native.Function<Transition>(library, "fmi3EnterStepMode");
        terminate = Native.Function<Transition>(library, "fmi3Terminate");
        update = Native.Function<UpdateDiscreteStates>(library, "fmi3UpdateDiscreteStates");
        doStep = Native.Function<DoStep>(library, "fmi3DoStep");
        set = Native.Function<Access>(library, "fmi3SetFloat64");
        get = Native.Function<Access>(library, "fmi3GetFloat64");
        free = Native.Function<Free>(library, "fmi3FreeInstance");
        instance = Native.Function<Instantiate>(library, "fmi3InstantiateCoSimulation")(
            "tissue", root.GetAttribute("instantiationToken"), IntPtr.Zero, false, false, true, false, IntPtr.Zero,
            UIntPtr.Zero, IntPtr.Zero, log, IntPtr.Zero);
        if (instance == IntPtr.Zero) throw new InvalidOperationException("the FMU refused its token");
        Require(Native.Function<EnterInitialization>(library, "fmi3EnterInitializationMode")(instance, false, 0, 0, false, 0));
        Require(Native.Function<Transition>(library, "fmi3ExitInitializationMode")(instance));
    }

    /// <summary>Force (N) at the position (mm) measured at this sample. Nothing is allocated.</summary>
    public double Step(double position)
    {
        if (samples > 0)
        {
            Require(doStep(instance, (samples - 1) * SamplingTime, SamplingTime, true, out _, out _, out _, out _));
            Require(enterEvent(instance));
        }
        uint input = Position, output = Force;
        var one = new UIntPtr(1);
        double force = 0;
        Require(set(instance, ref input, one, ref position, one));
        Require(update(instance, out _, out _, out _, out _, out _, out _));
        Require(get(instance, ref output, one, ref force, one));
        Require(enterStep(instance));
        ++samples;
        return force;
    }

    public void Dispose()
    {
        if (instance == IntPtr.Zero) return;
        terminate(instance);
        free(instance);
        instance = IntPtr.Zero;
    }

    static void Require(int status)
    {
        if (status > Warning) throw new InvalidOperationException("the FMU refused a call");
    }

    static void Logged(IntPtr environment, int status, IntPtr category, IntPtr message) =>
        Console.Error.WriteLine("FMU: " + Marshal.PtrToStringAnsi(message));

    static class Native
    {
        static readonly bool Windows = RuntimeInformation.IsOSPlatform(OSPlatform.Windows);
        static readonly bool Mac = RuntimeInformation.IsOSPlatform(OSPlatform.OSX);

        public static string Platform =>
            (RuntimeInformation.ProcessArchitecture == Architecture.Arm64 ? "aarch64-" : "x86_64-")
            + (Windows ? "windows" : Mac ? "darwin" : "linux");

        public static string Suffix => Windows ? ".dll" : Mac ? ".dylib" : ".so";

        [DllImport("kernel32", SetLastError = true, CharSet = CharSet.Unicode)]
        static extern IntPtr LoadLibraryW(string path);

        [DllImport("kernel32", CharSet = CharSet.Ansi)]
        static extern IntPtr GetProcAddress(IntPtr library, string name);

        [DllImport("libdl.so.2", EntryPoint = "dlopen")]
        static extern IntPtr OpenOnLinux(string path, int flags);

        [DllImport("libdl.so.2", EntryPoint = "dlsym")]
        static extern IntPtr FindOnLinux(IntPtr library, string name);

        [DllImport("/usr/lib/libSystem.dylib", EntryPoint = "dlopen")]
        static extern IntPtr OpenOnMac(string path, int flags);

        [DllImport("/usr/lib/libSystem.dylib", EntryPoint = "dlsym")]
        static extern IntPtr FindOnMac(IntPtr library, string name);

        public static IntPtr Open(string path)
        {
            var library = Windows ? LoadLibraryW(path) : Mac ? OpenOnMac(path, 2) : OpenOnLinux(path, 2);
            if (library == IntPtr.Zero) throw new DllNotFoundException(path);
            return library;
        }

        public static T Function<T>(IntPtr library, string name)
        {
            var address = Windows ? GetProcAddress(library, name)
                : Mac ? FindOnMac(library, name) : FindOnLinux(library, name);
            if (address == IntPtr.Zero) throw new EntryPointNotFoundException(name);
            return Marshal.GetDelegateForFunctionPointer<T>(address);
        }
    }

#if !UNITY_5_3_OR_NEWER
    static int Main(string[] arguments)
    {
        if (arguments.Length != 2)
        {
            Console.Error.WriteLine("usage: TissueForce FOLDER_OF_UNZIPPED_FMU POSITIONS.csv");
            return 1;
        }
        var rows = File.ReadAllLines(arguments[1]);
        using (var tissue = new TissueForce(arguments[0]))
        {
            Console.WriteLine("time,position,force");
            for (var row = 1; row < rows.Length; ++row)
            {
                var cells = rows[row].Split(',');
                var position = double.Parse(cells[1], CultureInfo.InvariantCulture);
                var force = tissue.Step(position);
                Console.WriteLine(string.Format(CultureInfo.InvariantCulture, "{0},{1:R},{2:R}", cells[0], position, force));
            }
        }
        return 0;
    }
#endif
}
