"""Synthetic experiments with hidden effects in three axes: records, and the truth that they hide.

    python tests/space_effects/make_cases.py FOLDER [--only coulomb,delay] [--seed 1]

writes a folder per case of ``cases.yaml`` with ``multisine.csv`` to train, ``strokes.csv``, ``raster.csv`` and ``loops.csv``
unseen, and ``truth.json``.
"""

import argparse
import json
import zlib
from pathlib import Path

import numpy as np
import space_tissue
import yaml
from space_motions import OVERSAMPLING, RATE_HZ, Motion, multisine, unseen

CASES = yaml.safe_load(Path(__file__).with_name("cases.yaml").read_text("utf-8"))
OBLIQUE = 0.9
"""Largest cosine between a principal axis and an axis of the records."""


def make_with_truth(name: str, seed: int = 1) -> tuple[dict[str, np.ndarray], dict]:
    """Records of a case by name, columns of time (s), position per axis (mm) and force per axis (N); and all that was drawn."""
    case = CASES[name]
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    motions = draw_motions(rng, case)
    truth = draw_truth(rng, case, motions["multisine"])
    clean = {
        record: space_tissue.measured_force(truth, motion)[::OVERSAMPLING]
        for record, motion in motions.items()
    }
    noise = draw_noise(rng, case, clean["multisine"])
    zero = rng.uniform(-0.1, 0.1, len(noise)) * rms(clean["multisine"])
    records = {}
    for record, motion in motions.items():
        position, force = motion.position[::OVERSAMPLING], clean[record]
        measured = force + zero + noise * rng.standard_normal(force.shape)
        records[record] = np.column_stack([np.arange(len(force)) / RATE_HZ, position, measured])
    truth |= {"case": name, "seed": seed, "noise_N": noise.tolist(), "zero_N": zero.tolist()}
    truth |= {key: case[key] for key in ("base", "symmetry", "unexcited", "expected") if key in case}
    truth["records"] = {record: shares(truth, motions[record], clean[record]) for record in motions}
    return records, truth


def write(folder: Path, name: str, seed: int = 1) -> dict:
    """Write a case's records and ``truth.json`` into ``folder/name``; gives the truth."""
    records, truth = make_with_truth(name, seed)
    target = Path(folder) / name
    target.mkdir(parents=True, exist_ok=True)
    for record, values in records.items():
        axes = axis_names(CASES[name])
        header = ["time_s", *(f"position_{axis}_mm" for axis in axes), *(f"force_{axis}_N" for axis in axes)]
        digits = ["%.2f"] + ["%.6f"] * (2 * len(axes))
        np.savetxt(target / f"{record}.csv", values, digits, ",", header=",".join(header), comments="")
    (target / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", "utf-8")
    return truth


def axis_names(case: dict) -> str:
    """Letters of the axes, in order."""
    return case.get("axes", "xyz")


def rms(values: np.ndarray) -> np.ndarray:
    """Standard deviation of each column."""
    return values.std(axis=0)


def draw_motions(rng: np.random.Generator, case: dict) -> dict[str, Motion]:
    """The four records' motions."""
    axes = axis_names(case)
    training = multisine(rng, len(axes))
    largest = float(np.linalg.norm(training.position, axis=1).max())
    motions = {"multisine": training, **unseen(rng, len(axes), largest)}
    if "unexcited" in case:
        share = np.ones(len(axes))
        share[axes.index(case["unexcited"]["axis"])] = case["unexcited"]["share"]
        motions = {record: motion.scaled(share) for record, motion in motions.items()}
    return motions


def draw_noise(rng: np.random.Generator, case: dict, clean: np.ndarray) -> np.ndarray:
    """Noise of each channel, N; that of an axis hardly excited is as large as the least of the others."""
    noise = rng.uniform(0.013, 0.017, clean.shape[1]) * rms(clean)
    if "unexcited" in case:
        weak = axis_names(case).index(case["unexcited"]["axis"])
        noise[weak] = np.delete(noise, weak).min()
    return noise


def draw_truth(rng: np.random.Generator, case: dict, motion: Motion) -> dict:
    """Tissue, effects and sensor of a case."""
    axes = len(axis_names(case))
    tissue = {} if case["base"] == "contact" else draw_tissue(rng, case, axes)
    truth = {"tissue": tissue, "effects": {}, "sensor": draw_sensor(rng, case.get("sensor"), axes)}
    truth["sensor_fault"] = case.get("sensor")
    force = float(np.linalg.norm(rms(space_tissue.base_force(tissue, motion))))
    for effect in case.get("effects", []):
        if effect != "saturation":
            truth["effects"][effect] = draw_effect(rng, effect, tissue, motion, force)
    if "saturation" in case.get("effects", []):
        truth["effects"]["saturation"] = draw_limits(rng, truth, motion)
    return truth


def draw_rotation(rng: np.random.Generator, axes: int) -> np.ndarray:
    """Rotation whose columns lie oblique to the axes of the records."""
    limit = OBLIQUE if axes == 3 else 0.94
    while True:
        rotation, _ = np.linalg.qr(rng.standard_normal((axes, axes)))
        if np.abs(rotation).max() < limit:
            return rotation * np.sign(np.linalg.det(rotation))


def draw_principal(rng: np.random.Generator, symmetry: str, axes: int, mean: float) -> np.ndarray:
    """Principal values of one matrix about `mean`, neighbours and extremes 1.3 to 4 times apart."""
    if symmetry == "isotropic":
        return np.full(axes, mean)
    if symmetry == "transverse":
        ratio = rng.uniform(1.5, 3.5)
        ratio = ratio if rng.random() < 0.6 else 1 / ratio
        values = np.array([ratio] + [1.0] * (axes - 1))
    else:
        values = rng.permutation(np.cumprod([1.0, *rng.uniform(1.3, 1.95, axes - 1)]))
    return mean * values / np.exp(np.mean(np.log(values)))


def draw_tissue(rng: np.random.Generator, case: dict, axes: int) -> dict:
    """Matrices of the base with principal values (N/mm, N s/mm) and axes (columns)."""
    symmetry, base = case["symmetry"], case["base"]
    elastic = float(rng.uniform(0.25, 0.9))
    # A dashpot as stiff as the spring at 1 to 3 Hz.
    means = {
        "K_e": elastic,
        "K_1": elastic * rng.uniform(0.7, 2.5),
        "B": elastic / (2 * np.pi * rng.uniform(1, 3)),
    }
    tissue: dict = {}
    rotation = np.eye(axes) if symmetry == "isotropic" else draw_rotation(rng, axes)
    for matrix in {"LE": ["K_e"], "KV": ["K_e", "B"], "Maxwell": ["K_1"], "KB": ["K_e", "K_1"]}[base]:
        principal = draw_principal(rng, symmetry, axes, means[matrix])
        if symmetry == "full":
            rotation = draw_rotation(rng, axes)
        values = rotation * principal @ rotation.T
        tissue[matrix] = ((values + values.T) / 2).tolist()
        tissue[f"{matrix}_principal"] = principal.tolist()
        tissue[f"{matrix}_axes"] = rotation.tolist()
    if "K_1" in tissue:
        tissue["tau_s"] = float(np.exp(rng.uniform(np.log(0.05), np.log(0.35))))
    return tissue


def draw_sensor(rng: np.random.Generator, fault: str | None, axes: int) -> list[list[float]]:
    """Matrix between force and channels."""
    matrix = np.eye(axes)
    if fault == "frame":
        axis = draw_rotation(rng, axes)[:, 0]
        angle = np.radians(rng.uniform(8, 15)) * rng.choice([-1, 1])
        skew = np.cross(np.eye(3), axis).T
        matrix = matrix + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    elif fault == "crosstalk":
        row, column = rng.choice(axes, 2, replace=False)
        matrix[row, column] = rng.choice([-1, 1]) * rng.uniform(0.06, 0.12)
    return matrix.tolist()


def draw_effect(
    rng: np.random.Generator, effect: str, tissue: dict, motion: Motion, force: float
) -> dict[str, float | list]:
    """Parameters of an effect, by the tissue, the training motion and the RMS of the tissue's force in it, N."""
    axes, largest = motion.position.shape[1], float(np.linalg.norm(motion.position, axis=1).max())
    slow = 0.03 * float(np.linalg.norm(motion.velocity, axis=1).max())
    match effect:
        case "coulomb_friction":
            return {"Fc": force * rng.uniform(0.1, 0.2), "vs": slow}
        case "hysteresis":
            return {"Fh": force * rng.uniform(0.12, 0.25), "d": largest * rng.uniform(0.06, 0.15)}
        case "hardening_stiffness":
            return {"k3": rng.uniform(0.2, 0.6) * float(np.mean(tissue["K_e_principal"])) / largest**2}
        case "quadratic_damping":
            unit = space_tissue.ADDED[effect](motion, 1.0)
            return {"c2": force * rng.uniform(0.08, 0.18) / float(np.linalg.norm(rms(unit)))}
        case "inertia":
            # 15 to 30 % of the tissue's force at 5 Hz.
            turn = 10j * np.pi
            relaxing = (
                turn * tissue["tau_s"] / (1 + turn * tissue["tau_s"]) * np.mean(tissue["K_1_principal"])
            )
            stiffness = float(abs(np.mean(tissue.get("K_e_principal", 0.0)) + relaxing))
            return {"m": rng.uniform(0.15, 0.3) * stiffness / abs(turn) ** 2}
        case "delay":
            return {"Td": round(rng.uniform(0.015, 0.03) / motion.step) * motion.step}
        case "drift":
            share = rng.uniform(0.3, 0.8, axes) * rng.choice([-1, 1], axes)
            return {"r": (share * force / np.sqrt(axes) / motion.time[-1]).tolist()}
        case "softening":
            lost = rng.uniform(0.35, 0.6) * min(tissue["K_e_principal"])
            return {"ks": lost, "s0": rng.uniform(0.08, 0.2) * float(motion.path[-1])}
        case "contact_plane":
            normal = draw_rotation(rng, 3)[:, 0]
            normal *= np.sign(normal[2])
            plane = {"k": float(rng.uniform(0.6, 1.5)), "n": normal.tolist()}
            plane["d0"] = float(np.std(motion.position @ normal)) * rng.uniform(-0.4, 0.2)
            return plane | {"mu": float(rng.uniform(0.2, 0.4)), "vs": slow}
    raise ValueError(f"no effect {effect}")


def draw_limits(rng: np.random.Generator, truth: dict, motion: Motion) -> dict:
    """Limits that clip 4 to 9 % of a channel's samples in training, of one channel or of all."""
    force = np.abs(space_tissue.measured_force(truth, motion))
    limits = [float(np.quantile(channel, 1 - rng.uniform(0.04, 0.09))) for channel in force.T]
    only = rng.integers(len(limits)) if rng.random() < 0.5 else None
    return {"Fs": [limit if only in (None, n) else None for n, limit in enumerate(limits)]}


def shares(truth: dict, motion: Motion, clean: np.ndarray) -> dict:
    """RMS of the force, and shares of it: noise by axis, each effect and fault of the sensor, samples clipped by axis."""
    result = {
        "force_rms_N": rms(clean).tolist(),
        "noise": (truth["noise_N"] / rms(clean)).tolist(),
        "effects": {},
    }
    without = {
        effect: truth | {"effects": {key: value for key, value in truth["effects"].items() if key != effect}}
        for effect in truth["effects"]
    }
    if truth["sensor_fault"]:
        without[truth["sensor_fault"]] = truth | {"sensor": np.eye(clean.shape[1])}
    for effect, other in without.items():
        missing = clean - space_tissue.measured_force(other, motion)[::OVERSAMPLING]
        result["effects"][effect] = float(np.linalg.norm(rms(missing)) / np.linalg.norm(rms(clean)))
    if "saturation" in truth["effects"]:
        limits = [np.inf if limit is None else limit for limit in truth["effects"]["saturation"]["Fs"]]
        result["clipped"] = np.mean(np.abs(clean) >= np.array(limits), axis=0).tolist()
    return result


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default=",".join(CASES), help="names of cases, with commas between")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    wanted = options.only.split(",")
    if unknown := set(wanted) - set(CASES):
        parser.error(f"--only: no case {', '.join(sorted(unknown))}; there are {', '.join(CASES)}")
    for name in wanted:
        truth = write(options.folder, name, options.seed)
        for record, row in truth["records"].items():
            noise = " ".join(f"{100 * share:.2f}" for share in row["noise"])
            effects = ", ".join(f"{effect} {100 * share:.1f} %" for effect, share in row["effects"].items())
            print(f"{name:24} {record:10} noise {noise} % {effects} {row.get('clipped', '')}", flush=True)


if __name__ == "__main__":
    main()
