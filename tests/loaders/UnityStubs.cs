// Stub of Unity for a test: the names that the package's sample uses, as far as it uses them.
using System;

namespace UnityEngine
{
    public class MonoBehaviour { }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class SerializeField : Attribute { }

    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
        public static Vector3 operator -(Vector3 a, Vector3 b) { return new Vector3(a.x - b.x, a.y - b.y, a.z - b.z); }
        public static Vector3 operator *(float factor, Vector3 a) { return new Vector3(factor * a.x, factor * a.y, factor * a.z); }
        public float this[int axis] { get { return axis == 0 ? x : axis == 1 ? y : z; } }
        public float magnitude { get { return (float)System.Math.Sqrt(Dot(this, this)); } }
        public static float Dot(Vector3 a, Vector3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
    }

    public class Transform
    {
        public Vector3 position;
        public Vector3 up = new Vector3(0, 1, 0);
    }

    public class Rigidbody
    {
        public Vector3 position, lastForce;
        public void AddForce(Vector3 force) { lastForce = force; }
    }

    public static class Time
    {
        public static double fixedTimeAsDouble;
    }

    public static class Application
    {
        public static string streamingAssetsPath;
    }

    public static class Debug
    {
        public static void LogWarning(object message) { Console.WriteLine("warning: " + message); }
    }
}

namespace AOT
{
    [AttributeUsage(AttributeTargets.Method)]
    public sealed class MonoPInvokeCallbackAttribute : Attribute
    {
        public MonoPInvokeCallbackAttribute(Type type) { Type = type; }
        public Type Type;
    }
}
