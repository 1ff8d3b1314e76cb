// Plays positions through an FMU with FMI4j and prints the forces as hexadecimal floats.
// Usage: java -cp 'JARS/*' PlayFmi4j.java FMU POSITIONS.csv STEP

import java.io.File;
import java.nio.file.Files;
import java.nio.file.Path;
import java.util.List;

import no.ntnu.ihb.fmi4j.importer.AbstractFmu;
import no.ntnu.ihb.fmi4j.importer.fmi2.CoSimulationSlave;
import no.ntnu.ihb.fmi4j.importer.fmi2.Fmu;

public class PlayFmi4j {
    public static void main(String[] arguments) throws Exception {
        long[] position = {1}, force = {2};
        double step = Double.parseDouble(arguments[2]);
        List<String> rows = Files.readAllLines(Path.of(arguments[1]));
        try (Fmu fmu = (Fmu) AbstractFmu.from(new File(arguments[0]))) {
            CoSimulationSlave slave = fmu.asCoSimulationFmu().newInstance("tissue");
            slave.simpleSetup();
            for (int k = 0; k + 1 < rows.size(); ++k) {
                double value = Double.parseDouble(rows.get(k + 1).split(",")[1]);
                slave.writeReal(position, new double[] {value});
                if (!slave.doStep(k * step, step)) throw new IllegalStateException("no step: " + slave.getLastStatus());
                double[] read = new double[1];
                slave.readReal(force, read);
                System.out.println(Double.toHexString(read[0]));
            }
            slave.terminate();
            slave.close();
        }
    }
}
