// A rigid body that is pushed into tissue: its depth below a surface goes into the FMU, the force pushes it out.
using System.IO;
using Lumbar;
using UnityEngine;

public sealed class PushOnTissue : MonoBehaviour
{
    const double MillimetresPerMetre = 1000.0;

    [SerializeField] string model = "KB";      // folder in StreamingAssets
    [SerializeField] Transform surface = null; // its up axis leads out of the tissue
    [SerializeField] Rigidbody tool = null;
    [SerializeField] float gain = 1.0f;

    TissueForce tissue;

    /// <summary>Force of the last step, in N; positive where it resists.</summary>
    public double Force { get; private set; }

    void OnEnable()
    {
        tissue = new TissueForce(Path.Combine(Application.streamingAssetsPath, model), Debug.LogWarning);
        tissue.Gain = gain;
        tissue.LongestGap = 1.0; // of a game that stutters
    }

    void OnDisable()
    {
        tissue.Dispose();
    }

    void FixedUpdate()
    {
        var depth = -Vector3.Dot(tool.position - surface.position, surface.up);
        Force = tissue.Step(Time.fixedTimeAsDouble, depth * MillimetresPerMetre);
        tool.AddForce((float)Force * surface.up);
    }
}
