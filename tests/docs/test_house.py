"""The picture of the rooms is that of the imports."""

from generate.house import DOCS, PAGE, arrows, page


def test_the_picture_is_up_to_date():
    assert (DOCS / PAGE).read_text(encoding="utf-8") == page(), "run 'make docs'"


def test_the_wings_are_apart_and_stand_on_the_records():
    rooms = {(one[0], other[0]) for one, other in arrows()}
    assert {
        ("tissue", "records"),
        ("lifting", "records"),
        ("interface", "tissue"),
        ("interface", "lifting"),
    } <= rooms
    assert not {("tissue", "lifting"), ("lifting", "tissue")} & rooms
