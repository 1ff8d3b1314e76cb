// Plays a file of times and positions through an FMI 3.0 FMU without Unity, as play_fmu.c does:
//
//   mcs -r:System.Xml PlayFmu.cs unity/Runtime/TissueForce.cs        (or both files in a project of dotnet)
//   mono PlayFmu.exe KB KB/resources/reference_input.csv gain=0.5
using System;
using System.Globalization;
using System.IO;
using Lumbar;

static class PlayFmu
{
    static string Written(params double[] values)
    {
        return string.Join(" ", Array.ConvertAll(values, value => value.ToString("G17", CultureInfo.InvariantCulture)));
    }

    static int Main(string[] arguments)
    {
        if (arguments.Length < 2)
        {
            Console.Error.WriteLine("usage: PlayFmu FOLDER_OF_UNZIPPED_FMU POSITIONS.csv [PARAMETER=VALUE ...]");
            return 1;
        }
        try
        {
            using (var tissue = new TissueForce(arguments[0], text => Console.Error.WriteLine("FMU: " + text)))
            {
                for (var i = 2; i < arguments.Length; ++i)
                {
                    var parts = arguments[i].Split('=');
                    tissue.Set(parts[0], double.Parse(parts[1], CultureInfo.InvariantCulture));
                }
                var rows = File.ReadAllLines(arguments[1]);
                Console.WriteLine("time,position,force");
                for (var row = 1; row < rows.Length; ++row)
                {
                    var cells = rows[row].Split(',');
                    var time = double.Parse(cells[0], CultureInfo.InvariantCulture);
                    var position = Array.ConvertAll(
                        cells[1].Split(' '), text => double.Parse(text, CultureInfo.InvariantCulture));
                    var force = new double[position.Length];
                    tissue.Step(time, position, force);
                    Console.WriteLine(string.Join(",", new[] { Written(time), Written(position), Written(force) }));
                }
            }
        }
        catch (Exception error)
        {
            Console.Error.WriteLine("PlayFmu: " + error.Message);
            return 1;
        }
        return 0;
    }
}
