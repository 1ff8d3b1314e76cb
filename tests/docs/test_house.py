"""The picture of the rooms is that of the imports."""

from generate.house import DOCS, PAGE, page


def test_the_picture_is_up_to_date():
    assert (DOCS / PAGE).read_text(encoding="utf-8") == page(), "run 'make docs'"
