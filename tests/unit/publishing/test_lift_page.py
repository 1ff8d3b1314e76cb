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


def numbers_of(html):
    """Return the text after each name of the four numbers."""
    (listed,) = re.findall(r'<dl class="numbers">(.*?)</dl>', html, flags=re.S)
    return {
        name: re.sub(r"<.*?>", " ", rest).split()
        for name, rest in re.findall(r"<dt>(.*?)</dt>(.*?)</div>", listed)
    }


def test_four_numbers_are_next_to_the_figure(saved_lift):
    numbers = numbers_of(saved_lift[1])
    assert len(numbers) == 4 and "N·m" in numbers["L5/S1 moment peak carried"]
    assert not any("computed:" in words or "nan" in words for words in numbers.values())
    assert (
        saved_lift[1].index('id="time"')
        < saved_lift[1].index('id="picture-side"')
        < saved_lift[1].index('"numbers"')
    )


def test_absent_parts_are_named_with_their_reason(tmp_path):
    lift = foreign_lift(tmp_path, L_SHOULDER=None, T12=PointBetween(between=("C7", "SACRUM"), share=0.7))
    html = lumbar.lift_page(lift).to_html()
    numbers = {name: " ".join(words) for name, words in numbers_of(html).items()}
    for name in ("L5/S1 moment peak carried", "Margin of stability", "Smallest impulse"):
        assert numbers[name] == "Not computed: no L_SHOULDER"
    assert has_tokens(numbers["Lumbar flexion peak carried"], "Not computed … T12")
    assert "°" not in re.sub(r"<script.*?</script>", "", html, flags=re.S)
    assert 'aria-label="Push">' in html and 'data-mark="☒"' in html


def test_lift_of_hands_without_a_deposit_has_no_empty_sections(tmp_path):
    boxes = dict.fromkeys([f"BOX_{number}" for number in range(1, 9)])
    html = lumbar.lift_page(foreign_lift(tmp_path, **boxes, L_WRIST=None, R_WRIST=None)).to_html()
    assert html.count("the deposit is not known") == 1
    assert all(words[:2] == ["Not", "computed:"] for words in numbers_of(html).values())
    assert all(f'aria-label="{name}" hidden>' in html for name in ("Pendulum", "Push"))
    assert 'data-mark="☒"' not in html
