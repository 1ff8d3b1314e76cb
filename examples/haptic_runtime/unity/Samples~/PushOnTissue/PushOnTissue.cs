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
    readonly double[] position = new double[3], force = new double[3];

    /// <summary>Force of the last step, in N; positive where it resists; of a model of three axes its length.</summary>
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
        if (tissue.Axes == 3)
        {
            PushInSpace(tool.position - surface.position);
            return;
        }
        var depth = -Vector3.Dot(tool.position - surface.position, surface.up);
        Force = tissue.Step(Time.fixedTimeAsDouble, depth * MillimetresPerMetre);
        tool.AddForce((float)Force * surface.up);
    }

    // The axes x, y and z of the model are the scene's; its force resists the motion, so that on the tool it acts against it.
    void PushInSpace(Vector3 moved)
    {
        for (var axis = 0; axis < 3; ++axis) position[axis] = moved[axis] * MillimetresPerMetre;
        tissue.Step(Time.fixedTimeAsDouble, position, force);
        var onTool = new Vector3((float)-force[0], (float)-force[1], (float)-force[2]);
        Force = onTool.magnitude;
        tool.AddForce(onTool);
    }
}
