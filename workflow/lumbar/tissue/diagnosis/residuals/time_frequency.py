"""Location of a model's error in time and frequency: by period or window, and by line or band."""

from itertools import pairwise

import numpy as np
import scipy

from lumbar.base.formats import plural
from lumbar.tissue.diagnosis.noise.nonrepeating import excess, remove_structure
from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, Residual, View, percent, probability

_WINDOWS = 10
_TREND = 0.05
"""Level of significance of a trend of the RMS."""
_MIN_CYCLE_SHARE = 0.5
"""Share of a window below which the rest of the record belongs to the window before."""
EXCITED, EVEN, ODD = "excited lines", "even lines", "odd lines left out"
ABOVE, BELOW, BETWEEN = "above the excited band", "below the excited band", "excited band"
_MIN_LINE_SHARE = 1e-2
"""Smallest amplitude of an excited line, as a share of the strongest one."""
_MIN_BAND_LINES = 4
_BAND_POWER = 0.998
"""Share of the input's power in the excited band of a record without lines."""


def time_view(residual: Residual) -> View:
    """Return RMS and mean of the residual by period or window.

    The table has the columns ``start``, ``stop`` (s), ``rms``, ``mean`` and ``deviation`` of the mean under noise.
    """
    edges = time_edges(residual)
    groups = np.searchsorted(edges, np.arange(len(residual.values)), side="right") - 1
    count = len(edges)
    average = residual.averages(groups, count)
    rms = np.sqrt(np.bincount(groups, residual.values**2, count) / average.count)
    stops = np.append(edges[1:], len(residual.values)) - 1
    # Slope of a straight line through the residual (unit/s), and its p-value under noise alone.
    centred = residual.time - residual.time.mean()
    weights = (centred / np.sum(centred**2))[None]
    slope = float(weights[0] @ residual.values)
    slope_deviation = float(np.sqrt(residual.covariance(weights)[0, 0]))
    slope_p = float(2 * scipy.special.ndtr(-abs(slope) / slope_deviation)) if slope_deviation > 0 else 1.0
    rms_p = mann_kendall_p(rms)
    table = {"start": residual.time[edges], "stop": residual.time[stops], "rms": rms}
    table |= {"mean": average.mean, "deviation": average.deviation}
    unit, word = residual.unit, "window" if residual.folding is None else "period"
    drift_p = min(1.0, 2 * min(slope_p, mann_kendall_p(average.mean)))
    is_drift = drift_p < SIGNIFICANT
    size = "without a significant trend" if rms_p > _TREND else "rising" if rms[-1] > rms[0] else "falling"
    spread = f"RMS from {rms.min():.3g} to {rms.max():.3g} {unit} over {plural(count, word)}, {size}"
    if is_drift:
        change = slope * (residual.time[-1] - residual.time[0])
        spread += f"; the mean drifts by {change:+.3g} {unit} over the record ({probability(drift_p)})"
    if residual.folding is None:
        level = "the mean error of the windows is within chance"
        if average.p_value < SIGNIFICANT:
            level = (
                "the mean error changes between windows by more than noise would: "
                f"{percent(average.share)} of the {residual.error_name}"
            )
            level += ", as for any smooth error" if average.share == 0 else ""
        unknown = "The input does not repeat, so time cannot be separated from the input at that time."
        sentence = f"Along time: {spread}; {level}. {unknown}"
        return View("time", average.significant_share, average.p_value, sentence, table)
    share, p_value = _not_repeating(residual)
    if p_value >= SIGNIFICANT:
        sentence = f"Along time: the error repeats with the input; {spread}."
        sentence += "" if is_drift else " Nothing depends on time alone."
        return View("time", 0.0, p_value, sentence, table)
    sentence = (
        f"Along time: {percent(share)} of the {residual.error_name} does not repeat with the input; {spread}. This part "
        "depends on time or history: a drift, a changing stiffness, or a disturbance at another frequency."
    )
    return View("time", share, p_value, sentence, table)


def time_edges(residual: Residual) -> np.ndarray:
    """Return the first samples of the windows: whole periods counted from the end, or equal windows."""
    size = len(residual.values)
    if residual.folding is None:
        return np.linspace(0, size, min(_WINDOWS, size // 8) + 1).astype(int)[:-1]
    starts = residual.folding.rows[:, 0]
    if starts[0] > _MIN_CYCLE_SHARE * residual.folding.samples:
        return np.insert(starts, 0, 0)
    return np.insert(starts[1:], 0, 0)


def mann_kendall_p(values: np.ndarray) -> float:
    """Return the two-sided p-value of a monotonic trend (Mann, Econometrica 13, 1945), normal approximation."""
    size = len(values)
    if size < 4:
        return 1.0
    score = np.sign(values[None, :] - values[:, None])[np.triu_indices(size, 1)].sum()
    deviation = np.sqrt(size * (size - 1) * (2 * size + 5) / 18)
    return float(min(1.0, 2 * scipy.special.ndtr(-max(abs(score) - 1, 0) / deviation)))


def _not_repeating(residual: Residual) -> tuple[float, float]:
    """Return the share of the residual's variance that differs between periods beyond noise, and its p-value."""
    folding, noise = residual.folding, residual.floor.rms**2
    folded = folding.fold(residual.values)
    mean = folded.mean(axis=0)
    parts = remove_structure(folded - mean, mean, folding.fold(residual.position).mean(axis=0)).parts
    if not parts:
        return 0.0, 1.0
    energy = float(np.sum(sum(part.values for part in parts) ** 2))
    degrees = sum(part.degrees for part in parts)
    p_value = float(scipy.special.ndtr(-excess(energy / noise, degrees))) if noise > 0 else 0.0
    before = int(folding.rows[0, 0])  # the samples of the transient count only if the periods differ
    transient = residual.values[:before] - mean[np.arange(-before, 0) % folding.samples]
    energy += max(float(np.sum(transient**2)) - before * noise * (1 + 1 / len(folded)), 0.0)
    return residual.share((energy - noise * degrees) / len(residual.values)), p_value


def excited_lines(mean_period: np.ndarray) -> np.ndarray:
    """Return the multiples of 1/period that the input excites."""
    amplitude = np.abs(np.fft.rfft(mean_period - mean_period.mean()))
    return np.flatnonzero(amplitude > _MIN_LINE_SHARE * amplitude.max())


def line_classes(excited: np.ndarray, count: int) -> np.ndarray:
    """Return the class of the lines 0, 1, …, count − 1.

    If all excited lines are odd, even lines show only an even nonlinearity (or an offset), and odd lines without excitation only
    an odd nonlinearity (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2012, section 4.3). On other
    grids, lines above and below the band show nonlinearity but not its kind.
    """
    lines = np.arange(count)
    if np.all(excited % 2 == 1):
        classes = np.where(lines % 2 == 0, EVEN, ODD)
    else:
        classes = np.where(lines > excited.max(), ABOVE, np.where(lines < excited.min(), BELOW, BETWEEN))
    classes = classes.astype(object)
    classes[excited] = EXCITED
    return classes


def line_view(residual: Residual) -> View:
    """Return the spectrum of the error of a record that repeats, by line; numbers are the shares of the classes of lines."""
    folding = residual.folding
    periods, samples = len(folding.rows), folding.samples
    mean = folding.fold(residual.values).mean(axis=0)
    excited = excited_lines(folding.fold(residual.position).mean(axis=0))
    frequency = np.fft.rfftfreq(samples, residual.sampling_time)
    sides = np.full(len(frequency), 2.0)
    sides[0] = 1.0
    if samples % 2 == 0:
        sides[-1] = 1.0
    power = sides * np.abs(np.fft.rfft(mean)) ** 2 / samples**2
    noise = sides * residual.noise_power(frequency) / (samples * periods)
    classes = line_classes(excited, len(frequency))
    shares, p_values = {}, {}
    for kind in dict.fromkeys(classes):
        mine = classes == kind
        statistic = float(np.sum((sides * power / noise)[mine])) if np.all(noise[mine] > 0) else np.inf
        # With an infinite statistic the probability is 0.
        p_values[kind] = float(scipy.special.chdtrc(sides[mine].sum(), statistic))
        is_significant = p_values[kind] < SIGNIFICANT
        shares[kind] = residual.share(float(np.sum((power - noise)[mine]))) if is_significant else 0.0
    numbers = {f"share {kind}": share for kind, share in shares.items()}
    share = residual.share(sum(shares.values()) * residual.explainable)
    p_value = min(1.0, len(p_values) * min(p_values.values()))  # Bonferroni
    sentence = "Over frequency: no line exceeds the noise."
    if p_value < SIGNIFICANT:
        lower, upper = _quartiles(power - noise, frequency)
        lines = _line_sentence(residual, shares, p_values, excited, classes, power - noise)
        sentence = f"Over frequency: half of the repeating error is {_range_text(lower, upper)}. {lines}"
    return View("frequency", share, p_value, sentence, numbers=numbers)


def _quartiles(power: np.ndarray, frequency: np.ndarray) -> tuple[float, float]:
    summed = np.cumsum(np.maximum(power, 0.0))
    quarter, three = np.searchsorted(summed / summed[-1], [0.25, 0.75])
    return float(frequency[quarter]), float(frequency[three])


def _range_text(lower: float, upper: float) -> str:
    """Format a range of frequencies in Hz, which may be one line."""
    low, high = f"{lower:.2g}", f"{upper:.2g}"
    return (
        f"between {low} and {high} Hz"
        if low != high
        else "a constant offset"
        if upper == 0
        else f"at {low} Hz"
    )


def _line_sentence(residual: Residual, shares, p_values, excited, classes, excess) -> str:
    on_excited = f"{percent(shares[EXCITED])} of the {residual.error_name} is on the {plural(len(excited), 'excited line')}"
    if not np.all(excited % 2 == 1):
        offset, above = shares.get(BELOW, 0.0), shares.get(ABOVE, 0.0)
        steady = f", {percent(offset)} is a constant offset or below them" if offset > 0.01 else ""
        higher = "above them nothing exceeds the noise"
        if above > 0:
            chance = probability(p_values[ABOVE])
            higher = f"{percent(above)} is above them ({chance}), where only a nonlinear force can put it"
        return (
            f"{on_excited}{steady}; {higher}; the grid excites even and odd lines equally, so it cannot separate them: an odd "
            "grid with detection lines would."
        )
    even, odd = shares.get(EVEN, 0.0), shares.get(ODD, 0.0)
    even_text = f"{percent(even)} on even multiples of the fundamental"
    if even > 0.05:
        even_text += " (even nonlinearity: a force that is not mirrored with the motion, such as one-sided contact or z²)"
    odd_text = f"{percent(odd)} on odd multiples that were left out"
    if odd > 0.05:
        odd_text += " (odd nonlinearity: a mirrored force, such as friction or z³)"
    parts = [on_excited, even_text, odd_text]
    inside = (classes == ODD) & (np.arange(len(classes)) <= excited.max())
    if odd > 0 and len(excited) > 1 and inside.sum() > 1:
        hidden = residual.share(len(excited) * float(np.mean(excess[inside])))
        parts.append(
            "if it is as strong on the excited lines, odd nonlinearity accounts for "
            f"{percent(min(hidden, shares[EXCITED]))} of the error there and linear dynamics for the rest"
        )
    if even == 0 and odd == 0:
        parts = [on_excited, "no nonlinearity exceeds the noise on the lines that were left out"]
    return "; ".join(parts) + "."


def band_view(residual: Residual) -> View:
    """Return the spectrum of the error of a record that does not repeat, by band."""
    size = len(residual.values)
    frequency = np.fft.rfftfreq(size, residual.sampling_time)
    window = np.hanning(size + 2)[1:-1]
    window /= np.sqrt(np.mean(window**2))
    power = 2 * np.abs(np.fft.rfft(residual.values * window)) ** 2 / size**2
    noise = 2 * residual.noise_power(frequency) / size
    excitation = np.abs(np.fft.rfft((residual.position - residual.position.mean()) * window)) ** 2
    edge = int(np.searchsorted(np.cumsum(excitation), _BAND_POWER * excitation.sum()))
    # Bands of lines above 0, a seventh of their frequency wide but not below a limit, one of them ending at the edge.
    bounds = [1]
    for stop in (min(edge + 1, len(frequency)), len(frequency)):
        while bounds[-1] < stop:
            width = max(_MIN_BAND_LINES, bounds[-1] // 7)
            bounds.append(stop if stop - bounds[-1] < 2 * width else bounds[-1] + width)
    pairs = list(pairwise(bounds))
    powers, noises = (np.array([item[low:high].sum() for low, high in pairs]) for item in (power, noise))
    inside = np.array([low <= edge for low, _ in pairs])
    if np.ptp(residual.position) == 0:
        sentence = f"Over frequency: the {residual.moved} does not move in this part."
        return View("frequency", 0.0, 1.0, sentence)
    if residual.floor is None:
        within, above = (percent(float(powers[band].sum() / powers.sum())) for band in (inside, ~inside))
        sentence = (
            f"Over frequency: {within} of the error is in the input's band up to {frequency[edge]:.2g} Hz, {above} above it; how "
            "much of that is noise is unknown, because no record repeats."
        )
        return View("frequency", 0.0, 1.0, sentence)
    p_values = [_band_p(power[low:high].sum(), noise[low:high].sum(), high - low) for low, high in pairs]
    p_value = min(1.0, len(p_values) * min(p_values))  # Bonferroni
    if p_value >= SIGNIFICANT:
        return View("frequency", 0.0, p_value, "Over frequency: no band exceeds the noise.")
    excess = np.maximum(powers - noises, 0.0)
    within = float(excess[inside].sum() / excess.sum())
    above_p = _band_p(power[edge + 1 :].sum(), noise[edge + 1 :].sum(), len(power) - edge - 1)
    lower, upper = _quartiles((power - noise)[1:], frequency[1:])
    higher = "above it nothing exceeds the noise"
    if above_p < SIGNIFICANT:
        above = percent(float(excess[~inside].sum() / excess.sum()))
        higher = f"{above} above it ({probability(above_p)}), where only a nonlinear force can put it"
    sentence = (
        f"Over frequency: half of the {residual.error_name} is {_range_text(lower, upper)}; {percent(within)} is in "
        f"the input's band up to {frequency[edge]:.2g} Hz, {higher}."
    )
    return View("frequency", residual.share(float(excess.sum())), p_value, sentence)


def _band_p(power: float, noise: float, lines: int) -> float:
    # A Hann window correlates the power of neighbouring lines by (2/3)², of next ones by (1/6)².
    repeated = 1 + 2 * (4 / 9 * (lines - 1) + max(lines - 2, 0) / 36) / lines
    degrees = 2 * lines / repeated
    return float(scipy.special.chdtrc(degrees, degrees * power / noise)) if noise > 0 else 0.0
