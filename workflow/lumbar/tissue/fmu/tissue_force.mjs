/* Loads the WebAssembly library of an FMI 3.0 FMU and plays it at any rate, in a browser or in Node: tissue_force.h in JavaScript.
 *
 *   lumbar export out/models.json --output fmu --model KB --target wasm32-wasi
 *   const tissue = await TissueForce.open(library, description);    bytes of binaries/wasm32-wasi/KB.wasm, text of modelDescription.xml
 *   const force = tissue.step(performance.now() / 1000, millimetres);
 *
 * Of a model of several axes positions and forces are arrays, and so are parameters that have a value for every axis.
 * The library imports nothing: it computes, and touches nothing else. One that is not wanted any more is collected as other objects are.
 */

/* Places in the library's memory for what FMI passes by address. */
const VALUE = 0, REACHED = 24, REFERENCE = 32, FLAGS = 40, ROOM = 48, MOST_AXES = 3;
const WARNING = 1;

export class TissueForce {
    #fmi; #memory; #room; #fmu; #variables = new Map(); #given = new Map(); #input; #output;
    #begun; #samples; #start; #lastTime; #lastPosition;

    /* Numbers that are a position, and a force. */
    axes;

    /* Largest time in s that may pass between two steps. */
    longestGap = 0.25;
    /* Sampling time of the FMU in s. */
    samplingTime;

    static async open(library, description) {
        const { instance } = await WebAssembly.instantiate(library, {});
        return new TissueForce(instance.exports, description);
    }

    constructor(fmi, description) {
        const attribute = (text, name) => new RegExp(`[\\s]${name}="([^"]*)"`).exec(text)?.[1];
        for (const [element, dimension] of description.matchAll(/<Float64\s[^>]*>(?:\s*<Dimension start="(\d+)")?/g)) {
            const causality = attribute(element, "causality"), name = attribute(element, "name");
            this.#variables.set(name, { reference: Number(attribute(element, "valueReference")), causality, size: Number(dimension ?? 1) });
            if (causality === "input") this.#input ??= name;
            if (causality === "output") this.#output ??= name;
        }
        this.samplingTime = Number(attribute(description, "fixedInternalStepSize"));
        if (!this.#input || !this.#output || !(this.samplingTime > 0)) throw new Error("modelDescription.xml is not of a force model");
        this.axes = this.#variables.get(this.#input).size;
        if (this.axes > MOST_AXES || this.axes !== this.#variables.get(this.#output).size) throw new Error("position and force are not along the same axes");
        this.#fmi = fmi;
        fmi._initialize();
        this.#room = fmi.malloc(ROOM);
        const name = this.#text("tissue"), token = this.#text(attribute(description, "instantiationToken"));
        this.#fmu = fmi.fmi3InstantiateCoSimulation(name, token, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0);
        if (!this.#fmu) throw new Error("the FMU refused its token: description and library differ");
        this.#memory = new DataView(fmi.memory.buffer); /* which grows no more: a step allocates nothing */
        this.#initialize();
    }

    /* Set a parameter, such as "gain", "force_limit" or "position_offset"; it stays through resets. */
    set(name, value) {
        if (this.#variables.get(name)?.causality !== "parameter") throw new Error(`the FMU has no parameter ${name}`);
        if (this.#put(name, value) > 0) throw new Error(`modelDescription.xml does not allow this value of ${name}`);
        this.#given.set(name, value);
    }

    /* Value of any variable. */
    get(name) {
        if (!this.#variables.has(name)) throw new Error(`the FMU has no variable ${name}`);
        const { reference, size } = this.#variables.get(name);
        this.#memory.setUint32(this.#room + REFERENCE, reference, true);
        const status = this.#fmi.fmi3GetFloat64(this.#fmu, this.#room + REFERENCE, 1, this.#room + VALUE, size);
        if (status > WARNING) throw new Error(`the FMU refused to tell ${name}`);
        if (size === 1) return this.#memory.getFloat64(this.#room + VALUE, true);
        return Array.from({ length: size }, (_, axis) => this.#memory.getFloat64(this.#room + VALUE + 8 * axis, true));
    }

    /* Begin anew, at rest, with the next step; parameters that were set stay. */
    reset() {
        if (this.#fmi.fmi3Reset(this.#fmu) > WARNING) throw new Error("the FMU refused to be reset");
        this.#initialize();
        for (const [name, value] of this.#given) this.set(name, value);
    }

    /* Force at the position measured at this time, in seconds of a clock that does not go back. After an error, and after a pause,
     * reset first. */
    step(time, position) {
        const tolerance = 1e-3 * this.samplingTime; /* clocks are sums of many steps */
        if (!Number.isFinite(time)) throw new Error("the time is not finite");
        const given = this.axes === 1 ? [position] : position;
        if (given.length !== this.axes) throw new Error(`a position of ${this.axes} numbers is needed`);
        if (!given.every(Number.isFinite)) { /* an encoder's hiccup: the last position stays */
            if (!this.#begun) throw new Error("the first position is not finite");
            position = this.#lastPosition;
        }
        const passed = this.#begun ? time - this.#lastTime : 0.0;
        if (passed < 0.0 || passed > this.longestGap) {
            throw new Error(`${passed} s since the last step; 0 to ${this.longestGap} are allowed. Are they seconds? After a pause reset first.`);
        }
        if (!this.#begun) {
            this.#begun = true;
            this.#start = this.#lastTime = time;
            this.#lastPosition = position;
        }
        for (;;) {
            const instant = this.#start + this.#samples * this.samplingTime;
            if (instant > time + tolerance) break;
            let at = position;
            if (instant < time - tolerance) at = this.#between((instant - this.#lastTime) / passed, position);
            this.#sample(at);
        }
        this.#lastTime = time;
        this.#lastPosition = position;
        return this.get(this.#output);
    }

    #between(share, position) {
        const last = this.#lastPosition;
        if (this.axes === 1) return last + share * (position - last);
        return position.map((along, axis) => last[axis] + share * (along - last[axis]));
    }

    /* One sample of the FMU: position in, in Event Mode. */
    #sample(position) {
        const fmi = this.#fmi, fmu = this.#fmu, step = this.samplingTime;
        const [event, ends, early, again, nominals, values, defined] = [0, 1, 2, 3, 4, 5, 6].map((place) => this.#room + FLAGS + place);
        let worst = 0;
        const took = (status) => { worst = Math.max(worst, status); };
        if (this.#samples === 0) {
            took(fmi.fmi3ExitInitializationMode(fmu)); /* into Event Mode */
        } else {
            took(fmi.fmi3DoStep(fmu, (this.#samples - 1) * step, step, 1, event, ends, early, this.#room + REACHED));
            took(fmi.fmi3EnterEventMode(fmu));
        }
        took(this.#put(this.#input, position));
        took(fmi.fmi3UpdateDiscreteStates(fmu, again, ends, nominals, values, defined, this.#room + REACHED));
        took(fmi.fmi3EnterStepMode(fmu));
        if (worst > WARNING) throw new Error("the FMU refused a step");
        ++this.#samples;
    }

    #initialize() {
        if (this.#fmi.fmi3EnterInitializationMode(this.#fmu, 0, 0.0, 0.0, 0, 0.0) > WARNING) throw new Error("the FMU refused to begin");
        this.#begun = false;
        this.#samples = 0;
    }

    #put(name, value) {
        const { reference, size } = this.#variables.get(name);
        this.#memory.setUint32(this.#room + REFERENCE, reference, true);
        for (let axis = 0; axis < size; ++axis) this.#memory.setFloat64(this.#room + VALUE + 8 * axis, value[axis] ?? value, true);
        return this.#fmi.fmi3SetFloat64(this.#fmu, this.#room + REFERENCE, 1, this.#room + VALUE, size);
    }

    #text(text) {
        const bytes = new TextEncoder().encode(`${text}\0`), place = this.#fmi.malloc(bytes.length);
        new Uint8Array(this.#fmi.memory.buffer).set(bytes, place);
        return place;
    }
}
