"""What is done on the page of a diagnosis, whether it is a file or served."""

import re

CASE = "case_03"
"""Experiment of the hidden effects that is diagnosed."""


def errors_of(page) -> list[float]:
    """Error of every rung of the ladder on unseen records."""
    rungs = page.locator("#ladder li").all_inner_texts()
    return [float(re.search(r": ([\d.]+) N on ", rung)[1]) for rung in rungs]


def add(page, title: str) -> None:
    page.evaluate("document.querySelectorAll('#why > details').forEach((item) => { item.open = true; })")
    page.locator("article.card").filter(has=page.get_by_role("heading", name=title)).get_by_role(
        "button", name="Add"
    ).click()
