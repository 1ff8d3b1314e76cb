"""What is done on the page of a diagnosis, whether it is a file or served."""

CASE = "case_03"
"""Experiment of the hidden effects that is diagnosed."""
ONE_SCREEN = ("#verdict", "#where", "#picture-course", "#picture-residual", "#ladder", "#chips")
"""Parts of the page that one screen must hold."""


def errors_of(page) -> list[float]:
    """Error of every rung of the ladder on unseen records."""
    return [float(text.split()[0]) for text in page.locator("#ladder .rung b").all_inner_texts()]


def add(page, effect: str) -> None:
    page.locator(f"#add [data-add={effect}]").click()


def path_of(page) -> list[str]:
    """Effects of the path, by the ladder."""
    return [
        text.strip().removeprefix("+ ")
        for text in page.locator("#ladder .rung > span:first-child").all_inner_texts()[1:]
    ]
