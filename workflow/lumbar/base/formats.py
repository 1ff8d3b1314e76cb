"""Numbers in sentences: without exponents where a reader expects none, and with nouns in the singular or plural."""


def format_number(value: float, digits: int) -> str:
    """Format a number with significant digits; a number below a million has no exponent.

    Examples
    --------
    >>> format_number(8734.0, 2), format_number(1.404, 3)
    ('8700', '1.4')
    """
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:.0f}" if 10.0**digits <= abs(rounded) < 1e6 else f"{value:.{digits}g}"


def percent(share: float) -> str:
    """Format a share in percent.

    Examples
    --------
    >>> percent(0.0123), percent(0.996), percent(1.0), percent(12.5)
    ('1.2 %', '99.6 %', '100 %', '1250 %')
    """
    if 0 < share < 0.001:
        return "less than 0.1 %"
    if 0.9995 <= share < 1:
        return "more than 99.9 %"
    if 0.99 < share < 1:
        return f"{100 * share:.1f} %"
    return f"{100 * share:.2g} %" if abs(share) < 0.095 else f"{100 * share:.0f} %"


def plural(count: int, noun: str) -> str:
    """Format a count and its noun, which takes an s if there is not exactly one.

    Examples
    --------
    >>> plural(1, "pole"), plural(2, "pole")
    ('1 pole', '2 poles')
    """
    return f"{count} {noun}{'s' * (count != 1)}"
