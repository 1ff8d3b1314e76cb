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
def test_report_is_accessible_and_fits_every_width(browser, report, scheme):
    page = browser.new_page(color_scheme=scheme)
    for anchor in ("", "#chapter-tissue"):
        page.goto(f"{report}{anchor}")
        fits(page, *WIDTHS)
        assert serious(page) == []
    page.close()


def test_first_screen_leads_to_one_chapter_at_a_time(browser, report):
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.goto(report)
    assert page.locator(".results a").first.bounding_box()["y"] < 300
    cards = page.locator("article:visible")
    # One picture for every artefact with a title, whether it was made once or for every lift.
    assert cards.count() == 5 and "1.0" not in page.locator("footer").inner_text()
    first = page.get_by_role("link", name="Table 3.1", exact=True)
    assert first.bounding_box()["y"] < 900
    first.click()
    assert page.locator(".chapter:visible").count() == 1 and page.locator("#overview").is_hidden()
    assert page.locator("#table_3_1 h3").bounding_box()["y"] < 200
    assert cards.count() == 1
    page.get_by_role("link", name="whole chapter").click()
    assert page.get_by_role("heading", name="System identification").bounding_box()["y"] < 200
    page.go_back()
    page.go_back()
    assert cards.count() == 5
    page.close()


def test_nothing_is_wider_than_paper_and_no_picture_is_lost(browser, report):
    page = browser.new_page(viewport={"width": 688, "height": 1000})  # A4 less its margins
    page.emulate_media(media="print")
    page.goto(report)
    assert page.evaluate(SIZES)[0] == 688
    drawn = page.evaluate("[...document.images].map(item => item.complete && item.naturalWidth > 100)")
    assert len(drawn) == 4 and all(drawn)
    page.close()
