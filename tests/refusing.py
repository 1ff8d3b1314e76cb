"""The message of an input error."""

import pytest

from lumbar.base.errors import InputError


def refusal(action, *arguments, **keywords) -> str:
    """Call a function that must raise an input error; return its message."""
    with pytest.raises(InputError) as caught:
        action(*arguments, **keywords)
    return str(caught.value)
