"""The report of a study in a real browser: nothing is wider than the page, on any screen or on paper."""

import pytest
from accessibility import WIDTHS, fits, serious

from small_report import make_results, page_of

pytestmark = pytest.mark.nightly

SIZES = """() => [document.documentElement.scrollWidth,
  [...document.querySelectorAll(".scroll")].filter(e => e.scrollWidth > e.clientWidth + 1).length]"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    file = tmp_path_factory.mktemp("report") / "report.html"
    file.write_text(page_of(make_results(file.parent)), encoding="utf-8")
    return file.as_uri()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_report_is_for_everybody_at_every_width_and_its_chapters_stay_in_sight(browser, report, scheme):
    page = browser.new_page(color_scheme=scheme)
    page.goto(report)
    fits(page, *WIDTHS)
    assert serious(page) == []
    for link in page.locator(".contents a").all():
        link.click()
        assert page.locator(".contents").bounding_box()["y"] == pytest.approx(0, abs=60)
    page.close()


def test_nothing_is_wider_than_paper_and_no_picture_is_lost(browser, report):
    page = browser.new_page(viewport={"width": 688, "height": 1000})  # A4 less its margins
    page.emulate_media(media="print")
    page.goto(report)
    assert page.evaluate(SIZES)[0] == 688
    drawn = page.evaluate("[...document.images].map(item => item.complete && item.naturalWidth > 100)")
    assert len(drawn) == 4 and all(drawn)
    page.close()
