/* Plays a file of times and positions through the WebAssembly library of an FMI 3.0 FMU, as play_fmu.c does through the machine's own.
 *
 *   unzip KB_fmi3.fmu -d KB
 *   node play_fmu.mjs KB KB/resources/reference_input.csv
 *   node play_fmu.mjs KB recording.csv gain=0.5 force_limit=5    parameters of the FMU
 */
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { TissueForce } from "../../workflow/lumbar/tissue/fmu/tissue_force.mjs";

function rows(text) {
    return text.trimEnd().split(/\r?\n/).slice(1).map((row) => {
        const [time, position, ...more] = row.split(",").map((cell) => cell.split(" ").map(Number));
        if (position === undefined || more.length) throw new Error(`not a row of time and position: ${row}`);
        return [time[0], position.length === 1 ? position[0] : position];
    });
}

try {
    const [folder, positions, ...parameters] = process.argv.slice(2);
    if (!positions) throw new Error("usage: node play_fmu.mjs FOLDER_OF_UNZIPPED_FMU POSITIONS.csv [PARAMETER=VALUE ...]");
    const description = readFileSync(join(folder, "modelDescription.xml"), "utf8");
    const identifier = /modelIdentifier="([^"]*)"/.exec(description)[1];
    const library = readFileSync(join(folder, "binaries", "wasm32-wasi", `${identifier}.wasm`));
    const tissue = await TissueForce.open(library, description);
    for (const given of parameters) {
        const [name, value] = given.split("=");
        if (value === undefined) throw new Error(`not PARAMETER=VALUE: ${given}`);
        tissue.set(name, Number(value));
    }
    const lines = ["time,position,force"];
    for (const [time, position] of rows(readFileSync(positions, "utf8"))) lines.push([time, position, tissue.step(time, position)].map((value) => [value].flat().join(" ")).join(","));
    console.log(lines.join("\n"));
} catch (error) {
    console.error(`play_fmu: ${error.message}`);
    process.exitCode = 1;
}
