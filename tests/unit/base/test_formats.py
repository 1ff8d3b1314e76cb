"""Numbers in sentences have no exponents, and nouns agree with them."""

import numpy as np

from lumbar.base.formats import format_number, percent, plural


def test_percentages_have_no_exponent_and_do_not_claim_all():
    shares = [*np.geomspace(1e-6, 1e3, 400), *-np.geomspace(1e-6, 1e3, 400)]
    assert not any("e" in percent(share).replace("less", "").replace("more", "") for share in shares)
    assert percent(0.9999) != percent(1.0) == "100 %"
    assert percent(1e-5) != percent(0.0) == "0 %"
    assert percent(0.0123) == "1.2 %"


def test_numbers_below_a_million_have_no_exponent():
    assert [format_number(value, 4) for value in (-25123.0, 1e5, 99.98, 0.01234)] == [
        "-25120",
        "100000",
        "99.98",
        "0.01234",
    ]


def test_nouns_agree_with_their_number():
    assert [plural(count, "pole") for count in range(3)] == ["0 poles", "1 pole", "2 poles"]
