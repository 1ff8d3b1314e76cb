"""Settings that a verb is given are checked.

Settings are plain dataclasses that take any value: a job that gets them from a checked study starts without Pydantic. So
it is `import lumbar`'s own verbs, which a person calls, that check what they are given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import is_dataclass
from functools import wraps
from typing import Any


def checking_settings(verb: Callable) -> Callable:
    """Return a verb that refuses settings with a wrong value.

    Raises
    ------
    InputError
        By the verb: with every key, what was found and what is allowed.
    """

    @wraps(verb)
    def checked(*arguments, **named):
        given = {name: _checked(value) for name, value in named.items()}
        return verb(*map(_checked, arguments), **given)

    return checked


def _checked(value: Any) -> Any:
    if not is_dataclass(value) or not hasattr(value, "__pydantic_config__"):
        return value
    from lumbar.base.errors import Problems
    from lumbar.settings.plain import plain
    from lumbar.study.validation import Origins, validate

    problems = Problems(type(value).__name__)
    found = validate(plain(value), type(value), problems, Origins())
    problems.raise_if_any()
    return found
