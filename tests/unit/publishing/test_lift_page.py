"""The page of a lift: the same bytes from a lift and from its folder, and only safe content."""

import re

import pytest

import lumbar


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
