"""The page of a lift: the same bytes from a lift and from its folder, and only safe content."""

import re

import pytest

import lumbar
from lumbar.settings.layout import PointBetween
from lumbar.settings.lifting import ALIASES, LiftingSettings
from lumbar.twin.examples import example_lift
from refusing import has_tokens


def test_lift_and_folder_give_the_same_file(saved_lift):
    html = lumbar.lift_page(saved_lift[0]).to_html()
    assert html == saved_lift[1]
    assert len(html) < 8e6
    elements = re.sub(r"<script.*?</script>", "", html, flags=re.S)  # what these load is tested in a browser
    assert not re.search(r'(src|href)\s*=\s*["\'](https?:)?//', elements)
    assert "synthetic twin" in html


def test_source_label_is_shown_and_not_run(saved_lift):
    html = lumbar.lift_page(saved_lift[0], source_label="a lab </script><script>alert(1)</script>").to_html()
    assert "a lab" in html and "</script><script>alert(1)" not in html


def test_folder_without_a_lift_is_rejected_with_the_missing_files(tmp_path):
    names = "body.csv, com.csv, pendulum.csv, pendulum.json, events.json"
    with pytest.raises(lumbar.InputError, match=rf"{names}\b.*'lumbar lift'"):
        lumbar.lift_page(tmp_path)


def foreign_lift(folder, **aliases):
    """Return a lift of a file whose laboratory has other markers than the twin's."""
    subject, layout = example_lift(folder / "lift.c3d"), LiftingSettings().markers
    markers = layout.model_copy(update={"aliases": {**ALIASES, **aliases}, "required": ()})
    settings = LiftingSettings().model_copy(update={"markers": markers})
    return lumbar.lift(folder / "lift.c3d", subject, settings=settings)


def test_absent_parts_are_one_sentence_after_the_figure(tmp_path):
    lift = foreign_lift(tmp_path, L_SHOULDER=None, T12=PointBetween(between=("C7", "SACRUM"), share=0.7))
    html = lumbar.lift_page(lift).to_html()
    (absent,) = re.findall(r'<p id="absent">(.*?)</p>', html)
    for tokens in (
        "L5/S1 moment peak carried, margin of stability, smallest impulse (no L_SHOULDER)",
        "flexion … T12",
    ):
        assert has_tokens(absent, tokens)
    assert "°" not in re.sub(r"<script.*?</script>", "", html, flags=re.S) and 'class="card"><h2>' not in html
    assert html.index('id="picture-side"') < html.index('id="absent"')
    assert 'aria-label="Push">' in html and 'data-mark="☒"' in html


def test_lift_of_hands_without_a_deposit_has_no_empty_sections(tmp_path):
    boxes = dict.fromkeys([f"BOX_{number}" for number in range(1, 9)])
    html = lumbar.lift_page(foreign_lift(tmp_path, **boxes, L_WRIST=None, R_WRIST=None)).to_html()
    assert html.count("the deposit is not known") == 1
    assert all(f'aria-label="{name}" hidden>' in html for name in ("Pendulum", "Push"))
    assert 'data-mark="☒"' not in html
