// A tissue model in Unity or any .NET program, from an FMI 3.0 FMU: time and position in, force out, at any rate.
//
//   var tissue = new TissueForce(folder);              the folder of an unzipped KB_fmi3.fmu
//   double force = tissue.Step(seconds, millimetres);  on the device's thread
//   tissue.Dispose();                                  frees the FMU and its library
//
// A model of several axes takes and gives Axes numbers: tissue.Step(seconds, position, force).
//
// The FMU samples the position by its own clock. Give each step the time that has passed on yours: a faster loop feels each
// force held until the next sample, for a slower one positions in between are taken from a straight line. Step allocates
// nothing, prints nothing and waits for nothing. Works under Mono and IL2CPP: the one callback is static and marked.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Runtime.InteropServices;
using System.Xml;

namespace Lumbar
{
    public sealed class TissueForce : IDisposable
    {
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

        // Static, so that IL2CPP can compile it ahead of time, and never collected while an FMU holds it.
        static readonly LogMessage Callback = Logged;
        static readonly UIntPtr One = new UIntPtr(1);
        const int MostAxes = 3;

        readonly Action<string> log;
        readonly Dictionary<string, uint> references = new Dictionary<string, uint>();
        readonly Dictionary<string, int> sizes = new Dictionary<string, int>();
        readonly Dictionary<string, double[]> parameters = new Dictionary<string, double[]>();
        readonly EnterInitialization enterInitialization;
        readonly Transition exitInitialization, enterEvent, enterStep, terminate, reset;
        readonly UpdateDiscreteStates update;
        readonly DoStep doStep;
        readonly Access set, get;
        readonly Free free;
        GCHandle self;
        IntPtr library, instance;
        uint input, output;
        bool begun;
        double start, lastTime;
        readonly double[] single = new double[1], now = new double[MostAxes], at = new double[MostAxes], last = new double[MostAxes];
        UIntPtr axes;
        long samples;

        /// <summary>Seconds between the samples of the FMU; Step may be called at any other rate.</summary>
        public double SamplingTime { get; private set; }

        /// <summary>Numbers that are a position, and a force.</summary>
        public int Axes { get; private set; }

        /// <summary>Names and units of what goes in and comes out, such as position in mm and force in N.</summary>
        public string InputName { get; private set; }
        public string InputUnit { get; private set; }
        public string OutputName { get; private set; }
        public string OutputUnit { get; private set; }

        /// <summary>Sign of the force that resists a growing position: 1, or −1 for an inverted model such as IL.</summary>
        public int ResistingSign { get; private set; }

        /// <summary>Positions, speed and band (Hz) of the motion that the model was fitted to; NaN where the FMU does not say.</summary>
        public double Lowest { get; private set; }
        public double Highest { get; private set; }
        public double Speed { get; private set; }
        public double LowestHz { get; private set; }
        public double HighestHz { get; private set; }

        /// <summary>Longest time between two steps, in seconds: a longer one is an error, which tells milliseconds from seconds.</summary>
        public double LongestGap { get; set; }

        /// <summary>Factor on the model's force.</summary>
        public double Gain { get { return Get("gain"); } set { Set("gain", value); } }

        /// <summary>Force at rest.</summary>
        public double ForceOffset { get { return Get(OutputName + "_offset"); } set { Set(OutputName + "_offset", value); } }

        /// <summary>Largest magnitude of the force; it can be lowered, not raised.</summary>
        public double ForceLimit { get { return Get(OutputName + "_limit"); } set { Set(OutputName + "_limit", value); } }

        /// <summary>Position at which the model is at rest.</summary>
        public double PositionOffset { get { return Get(InputName + "_offset"); } set { Set(InputName + "_offset", value); } }

        /// <summary>Load the FMU in a folder. Without a log it is silent; with one it is told warnings as text.</summary>
        public TissueForce(string folder, Action<string> log = null)
        {
            this.log = log;
            LongestGap = 0.25;
            var root = Described(Path.Combine(folder, "modelDescription.xml"));
            var identifier = root["CoSimulation"].GetAttribute("modelIdentifier");
            var path = Path.GetFullPath(Path.Combine(folder, "binaries", Native.Platform, identifier + Native.Suffix));
            if (!File.Exists(path)) throw new DllNotFoundException("the FMU has no library for " + Native.Platform + ": " + path);
            library = Native.Open(path);
            try
            {
                enterInitialization = Native.Function<EnterInitialization>(library, "fmi3EnterInitializationMode");
                exitInitialization = Native.Function<Transition>(library, "fmi3ExitInitializationMode");
                enterEvent = Native.Function<Transition>(library, "fmi3EnterEventMode");
                enterStep = Native.Function<Transition>(library, "fmi3EnterStepMode");
                terminate = Native.Function<Transition>(library, "fmi3Terminate");
                reset = Native.Function<Transition>(library, "fmi3Reset");
                update = Native.Function<UpdateDiscreteStates>(library, "fmi3UpdateDiscreteStates");
                doStep = Native.Function<DoStep>(library, "fmi3DoStep");
                set = Native.Function<Access>(library, "fmi3SetFloat64");
                get = Native.Function<Access>(library, "fmi3GetFloat64");
                free = Native.Function<Free>(library, "fmi3FreeInstance");
                self = GCHandle.Alloc(this, GCHandleType.Weak);
                instance = Native.Function<Instantiate>(library, "fmi3InstantiateCoSimulation")(
                    "tissue", root.GetAttribute("instantiationToken"), IntPtr.Zero, false, log != null, true, false, IntPtr.Zero,
                    UIntPtr.Zero, GCHandle.ToIntPtr(self), Callback, IntPtr.Zero);
                if (instance == IntPtr.Zero)
                    throw new InvalidOperationException("the FMU refused its token: description and library differ");
                Initialize();
            }
            catch
            {
                Dispose();
                throw;
            }
        }

        /// <summary>Force at the position measured at this time, in seconds of a clock that does not go back. Nothing is allocated.
        /// Throws where time goes back or jumps: the device must then be stopped, and Reset called before the next step.</summary>
        public double Step(double time, double position)
        {
            if (Axes > 1) throw new InvalidOperationException("the model has several axes: take Step(time, position, force)");
            single[0] = position;
            Step(time, single, single);
            return single[0];
        }

        /// <summary>The same along every axis: position and force have Axes numbers.</summary>
        public void Step(double time, double[] position, double[] force)
        {
            if (instance == IntPtr.Zero) throw new ObjectDisposedException("TissueForce");
            if (double.IsNaN(time) || double.IsInfinity(time)) throw new ArgumentException("the time is not finite");
            var finite = true;
            for (var i = 0; i < Axes; ++i) finite &= !(double.IsNaN(position[i]) || double.IsInfinity(position[i]));
            if (!finite && !begun) throw new ArgumentException("the first position is not finite");
            Array.Copy(finite ? position : last, now, Axes); // an encoder's hiccup: the last position stays
            var passed = begun ? time - lastTime : 0.0;
            if (passed < 0.0 || passed > LongestGap)
                throw new ArgumentException(string.Format(
                    CultureInfo.InvariantCulture,
                    "{0:G6} s since the last step; 0 to {1:G6} are allowed. Are they seconds? After a pause reset first.", passed,
                    LongestGap));
            if (!begun)
            {
                begun = true;
                start = lastTime = time;
                Array.Copy(now, last, Axes);
            }
            var near = 1e-3 * SamplingTime; // clocks are sums of many steps
            for (;;)
            {
                var instant = start + samples * SamplingTime;
                if (instant > time + near) break;
                for (var i = 0; i < Axes; ++i)
                {
                    at[i] = now[i];
                    if (instant < time - near) at[i] = last[i] + (instant - lastTime) / passed * (now[i] - last[i]);
                }
                Sample(at);
            }
            lastTime = time;
            Array.Copy(now, last, Axes);
            Require(get(instance, ref output, One, ref force[0], axes));
        }

        /// <summary>Begin anew, at rest, with the next step; parameters that were set stay.</summary>
        public void Reset()
        {
            if (instance == IntPtr.Zero) throw new ObjectDisposedException("TissueForce");
            Require(reset(instance));
            Initialize();
            foreach (var parameter in parameters) Assign(parameter.Key, parameter.Value);
        }

        /// <summary>Set a parameter by its name in modelDescription.xml; one with a value for every axis gets a single one along
        /// each.</summary>
        public void Set(string name, params double[] values)
        {
            var given = new double[MostAxes];
            for (var i = 0; i < MostAxes; ++i) given[i] = values[Math.Min(i, values.Length - 1)];
            Assign(name, given);
            parameters[name] = given;
        }

        /// <summary>Value of any variable by its name in modelDescription.xml, the first of several.</summary>
        public double Get(string name)
        {
            if (instance == IntPtr.Zero) throw new ObjectDisposedException("TissueForce");
            var reference = Reference(name);
            var values = new double[MostAxes];
            Require(get(instance, ref reference, One, ref values[0], new UIntPtr((uint)sizes[name])));
            return values[0];
        }

        public void Dispose()
        {
            GC.SuppressFinalize(this);
            Release();
        }

        ~TissueForce() { Release(); }

        void Release()
        {
            if (instance != IntPtr.Zero)
            {
                terminate(instance);
                free(instance);
                instance = IntPtr.Zero;
            }
            if (library != IntPtr.Zero) Native.Close(library);
            library = IntPtr.Zero;
            if (self.IsAllocated) self.Free();
        }

        XmlElement Described(string path)
        {
            var description = new XmlDocument { XmlResolver = null };
            description.Load(path);
            var root = description.DocumentElement;
            if (!root.GetAttribute("fmiVersion").StartsWith("3."))
                throw new NotSupportedException("not an FMU of FMI 3.0: unzip <model>_fmi3.fmu (" + path + ")");
            SamplingTime = Number(root["CoSimulation"].GetAttribute("fixedInternalStepSize"));
            foreach (XmlElement variable in root["ModelVariables"].GetElementsByTagName("Float64"))
            {
                var name = variable.GetAttribute("name");
                references[name] = uint.Parse(variable.GetAttribute("valueReference"), CultureInfo.InvariantCulture);
                var dimension = variable["Dimension"];
                sizes[name] = dimension == null ? 1 : int.Parse(dimension.GetAttribute("start"), CultureInfo.InvariantCulture);
                var causality = variable.GetAttribute("causality");
                if (causality == "input" && InputName == null)
                {
                    InputName = name;
                    InputUnit = variable.GetAttribute("unit");
                }
                if (causality == "output" && OutputName == null)
                {
                    OutputName = name;
                    OutputUnit = variable.GetAttribute("unit");
                }
            }
            input = Reference(InputName ?? "input");
            output = Reference(OutputName ?? "output");
            Axes = sizes[InputName];
            axes = new UIntPtr((uint)Axes);
            if (Axes < 1 || Axes > MostAxes || sizes[OutputName] != Axes)
                throw new NotSupportedException("position and force are not along the same one to three axes (" + path + ")");
            Understand(root["Annotations"]);
            return root;
        }

        void Understand(XmlElement annotations)
        {
            var text = "";
            if (annotations != null)
                foreach (XmlElement annotation in annotations.GetElementsByTagName("Annotation"))
                    if (annotation.GetAttribute("type") == "lumbar") text = annotation.InnerText;
            ResistingSign = Told(text, "resisting_sign") < 0 ? -1 : 1;
            Lowest = Told(text, "lowest");
            Highest = Told(text, "highest");
            Speed = Told(text, "speed");
            LowestHz = Told(text, "lowest_Hz");
            HighestHz = Told(text, "highest_Hz");
        }

        /// A number of the JSON object; no JSON parser is at hand in all of Unity's versions.
        static double Told(string text, string name)
        {
            var key = "\"" + name + "\": ";
            var at = text.IndexOf(key, StringComparison.Ordinal);
            if (at < 0) return double.NaN;
            at += key.Length;
            var end = text.IndexOfAny(new[] { ',', '}' }, at);
            return end < 0 ? double.NaN : Number(text.Substring(at, end - at));
        }

        static double Number(string text)
        {
            return double.Parse(text, NumberStyles.Float, CultureInfo.InvariantCulture);
        }

        uint Reference(string name)
        {
            uint reference;
            if (references.TryGetValue(name, out reference)) return reference;
            throw new ArgumentException("the FMU has no variable " + name);
        }

        void Assign(string name, double[] values)
        {
            if (instance == IntPtr.Zero) throw new ObjectDisposedException("TissueForce");
            var reference = Reference(name);
            var size = new UIntPtr((uint)sizes[name]);
            if (reference == input || reference == output || set(instance, ref reference, One, ref values[0], size) > 0)
                throw new ArgumentOutOfRangeException(
                    name, values[0], "modelDescription.xml does not allow this value of " + name);
        }

        void Initialize()
        {
            Require(enterInitialization(instance, false, 0, 0, false, 0));
            begun = false;
            samples = 0;
        }

        /// One sample of the FMU: position in, in Event Mode.
        void Sample(double[] position)
        {
            byte again, ends, nominals, values, defined, eventNeeded, early;
            double next;
            if (samples == 0)
            {
                Require(exitInitialization(instance)); // into Event Mode
            }
            else
            {
                Require(doStep(
                    instance, (samples - 1) * SamplingTime, SamplingTime, true, out eventNeeded, out ends, out early, out next));
                Require(enterEvent(instance));
            }
            Require(set(instance, ref input, One, ref position[0], axes));
            Require(update(instance, out again, out ends, out nominals, out values, out defined, out next));
            Require(enterStep(instance));
            ++samples;
        }

        static void Require(int status)
        {
            if (status > Warning) throw new InvalidOperationException("the FMU refused a call");
        }

        [AOT.MonoPInvokeCallback(typeof(LogMessage))]
        static void Logged(IntPtr environment, int status, IntPtr category, IntPtr message)
        {
            // An exception must not pass through native code.
            try
            {
                if (environment == IntPtr.Zero) return;
                var tissue = GCHandle.FromIntPtr(environment).Target as TissueForce;
                if (tissue != null && tissue.log != null) tissue.log(Marshal.PtrToStringAnsi(message));
            }
            catch (Exception)
            {
            }
        }

        static class Native
        {
            static readonly bool Windows = RuntimeInformation.IsOSPlatform(OSPlatform.Windows);
            static readonly bool Mac = RuntimeInformation.IsOSPlatform(OSPlatform.OSX);

            public static string Platform
            {
                get
                {
                    return (RuntimeInformation.ProcessArchitecture == Architecture.Arm64 ? "aarch64-" : "x86_64-")
                        + (Windows ? "windows" : Mac ? "darwin" : "linux");
                }
            }

            public static string Suffix { get { return Windows ? ".dll" : Mac ? ".dylib" : ".so"; } }

            [DllImport("kernel32", SetLastError = true, CharSet = CharSet.Unicode)]
            static extern IntPtr LoadLibraryW(string path);

            [DllImport("kernel32", CharSet = CharSet.Ansi)]
            static extern IntPtr GetProcAddress(IntPtr library, string name);

            [DllImport("kernel32")]
            static extern bool FreeLibrary(IntPtr library);

            [DllImport("libdl.so.2", EntryPoint = "dlopen")]
            static extern IntPtr OpenOnLinux(string path, int flags);

            [DllImport("libdl.so.2", EntryPoint = "dlsym")]
            static extern IntPtr FindOnLinux(IntPtr library, string name);

            [DllImport("libdl.so.2", EntryPoint = "dlclose")]
            static extern int CloseOnLinux(IntPtr library);

            [DllImport("/usr/lib/libSystem.dylib", EntryPoint = "dlopen")]
            static extern IntPtr OpenOnMac(string path, int flags);

            [DllImport("/usr/lib/libSystem.dylib", EntryPoint = "dlsym")]
            static extern IntPtr FindOnMac(IntPtr library, string name);

            [DllImport("/usr/lib/libSystem.dylib", EntryPoint = "dlclose")]
            static extern int CloseOnMac(IntPtr library);

            public static IntPtr Open(string path)
            {
                var library = Windows ? LoadLibraryW(path) : Mac ? OpenOnMac(path, 2) : OpenOnLinux(path, 2);
                if (library == IntPtr.Zero) throw new DllNotFoundException("cannot be loaded: " + path);
                return library;
            }

            public static void Close(IntPtr library)
            {
                if (Windows) FreeLibrary(library);
                else if (Mac) CloseOnMac(library);
                else CloseOnLinux(library);
            }

            public static T Function<T>(IntPtr library, string name)
            {
                var address = Windows ? GetProcAddress(library, name)
                    : Mac ? FindOnMac(library, name) : FindOnLinux(library, name);
                if (address == IntPtr.Zero) throw new EntryPointNotFoundException(name);
                return Marshal.GetDelegateForFunctionPointer<T>(address);
            }
        }
    }
}

#if !UNITY_5_3_OR_NEWER
namespace AOT
{
    // Unity's own attribute, by which IL2CPP knows what native code may call; elsewhere it says nothing.
    [AttributeUsage(AttributeTargets.Method)]
    sealed class MonoPInvokeCallbackAttribute : Attribute
    {
        public MonoPInvokeCallbackAttribute(Type type) { }
    }
}
#endif
