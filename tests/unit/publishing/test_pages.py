"""Evidence, equations, signatures and building blocks of the page of a diagnosis."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from periodic_records import STEP, multisine, noise, record, relaxing_force

import lumbar
from lumbar.publishing.explorer.one_file import embed_pictures, one_file, plain_figure
from lumbar.publishing.pages.html import document, figure, listing, paragraph, table
from lumbar.tissue.diagnosis.evidence.evidence import detectable_effects
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.candidate import likelihood_ratio
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL, NullDistribution, null_distribution
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.effects.signature import RATES, SHARE, signatures, standard_motion
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.printing import equation_mathml

SIGMA = 0.02


def records(extra=lambda z: 0.0 * z, periods=8):
    first, second = 0.5 * multisine(periods, 500, range(1, 25), 1), 0.5 * multisine(3, 500, range(1, 25), 2)
    return [
        record(first, relaxing_force(first) + extra(first) + SIGMA * noise(len(first), 3), "multisine"),
        record(second, relaxing_force(second) + extra(second) + SIGMA * noise(len(second), 4), "other"),
    ]


def test_effect_of_the_detectable_size_gains_the_threshold():
    """A force of three times the stated size, added to records of the base, gains nine times the threshold."""
    tests = records()
    settings = DiagnosisSettings("KB", catalogue={"inertia": TISSUE["inertia"]})
    diagnosis = diagnose(tests, settings)
    assert diagnosis.selected == ()
    result = {item.effect: item for item in detectable_effects(diagnosis, TISSUE, null_distribution())}
    forms = sum(len(effect.forms) for effect in TISSUE.values())
    threshold = null_distribution().threshold(forms)
    # Inertia has one form and no shape: one size is stated.
    stated = result["inertia"]
    assert stated.easiest == pytest.approx(stated.hardest)
    data = diagnosis.experiment.training
    mass = 3 * stated.easiest / np.sqrt(np.mean(data.motion.acceleration[data.first :] ** 2))
    larger = diagnose(records(lambda z: mass * acceleration(z)), settings)
    single = next(item.candidate for item in larger.ranking if item.candidate.effects == ("inertia",))
    # Twice the log-likelihood of a force in noise scatters by 2 √(its mean).
    assert likelihood_ratio(larger.base, single, larger.experiment) == pytest.approx(
        9 * threshold, abs=2.5 * 2 * np.sqrt(9 * threshold)
    )


def acceleration(position: np.ndarray) -> np.ndarray:
    """Second derivative by the spectrum: the records are whole periods of lines up to 4.8 Hz."""
    omega = 2 * np.pi * np.fft.rfftfreq(len(position), STEP)
    return np.fft.irfft(-(omega**2) * np.fft.rfft(position), len(position))


def test_threshold_is_99th_percentile_of_null_gains():
    null = NullDistribution(np.sort(np.random.default_rng(1).chisquare(3, 1000)), 30)
    threshold = null.threshold(30)
    assert null.p_value(threshold, 30) <= LEVEL < null.p_value(threshold - 0.2, 30)
    assert null.threshold(60) > threshold


FORMS = [form for effect in TISSUE.values() for form in effect.forms]


@pytest.mark.parametrize("equation", [form.latex for form in FORMS] + [base.latex for base in BASES.values()])
def test_mathml_has_every_letter_of_equation(equation):
    root = ElementTree.fromstring(equation_mathml(equation))
    letters = re.sub(r"\\[A-Za-z]+|[^A-Za-z]", "", equation)
    assert set(letters) <= set("".join(root.itertext()))


@pytest.mark.parametrize(
    "latex", [r"\nonsense{", r"\nonsense x", r"\text{<b>}", r"\text{<script>1</script>}", "", "x^"]
)
def test_invalid_equations_are_rejected(latex):
    with pytest.raises(lumbar.InputError, match=rf"{re.escape(repr(latex))}.*LaTeX"):
        equation_mathml(latex)


def test_equation_contains_no_link():
    assert "javascript" not in equation_mathml(r"\href{javascript:alert(1)}{x}")


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.key)
def test_signatures_have_stated_size(form):
    slow, fast = signatures(TISSUE[form.effect], form)
    share = np.sqrt(np.mean(slow.added_force**2) / np.mean(slow.base**2))
    assert np.all(np.isfinite(fast.force))
    if form.place is Place.PARALLEL:
        assert share == pytest.approx(SHARE)
    else:
        assert 0.03 < share < 3 * SHARE


def test_signatures_follow_closed_forms():
    position = standard_motion(RATES[0]).position
    cubic = signatures(TISSUE["hardening_stiffness"])[0].added_force
    assert cubic == pytest.approx(cubic.max() * position**3, abs=1e-9 + 1e-4 * cubic.max())
    clipped = signatures(TISSUE["saturation"])[0].force
    assert np.ptp(clipped[np.abs(clipped) > 0.999 * clipped.max()].__abs__()) < 1e-3 * clipped.max()
    slow, fast = signatures(TISSUE["inertia"])
    ratio = np.abs(fast.added_force[600:-10]).max() / np.abs(slow.added_force[600:-10]).max()
    assert ratio == pytest.approx((RATES[1] / RATES[0]) ** 2, rel=0.02)


def test_building_blocks_escape_their_arguments(tmp_path):
    page = document("a < b", "x & y", [paragraph("-1 < 2, 3-4"), listing(["<b>"]), table(["<h>"], [["a&b"]])])
    assert "a &lt; b" in page and "x &amp; y" in page and "−1 &lt; 2, 3-4" in page
    assert "<b>" not in page.split("</header>")[1].replace("<p><b>Data", "").replace("</b>", "")
    assert "a&amp;b" in page
    (tmp_path / "empty.svg").write_text("<svg/>")
    assert "<figcaption>a &amp; b</figcaption>" in figure(tmp_path / "empty.svg", "a & b")


def test_numbering_of_bokeh_ids_keeps_encoded_arrays():
    """In millions of encoded letters some look like a name."""
    coded = "AAA+p12345/A 01234567-0123-0123-0123-0123456789ab b"
    pictures = embed_pictures(lambda document: document.add_root(plain_figure("a", "", "", 0)))
    variables = {"title": "", "data": "", "content": {"coded": coded}}
    text = one_file(pictures, "publishing/explorer/shell.html.jinja", variables)
    assert coded in text and not re.search(r'"p\d{4,}"', text)
