"""The message of an input error, and the tokens in it that do not change with its wording."""

import re

import pytest

from lumbar.base.errors import InputError


def refusal(action, *arguments, **keywords) -> str:
    """Call a function that must raise an input error; return its message."""
    with pytest.raises(InputError) as caught:
        action(*arguments, **keywords)
    return str(caught.value)


def has_tokens(text: str, tokens: str) -> bool:
    """Return whether one line of a text has these tokens, separated by ``…``, as whole words in this order."""
    parts = [re.sub(r"^\b|\b$", r"\\b", re.escape(token.strip())) for token in tokens.split("…")]
    return re.search(".*?".join(parts), text) is not None
