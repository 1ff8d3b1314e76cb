"""The words in which something is refused."""

import pytest

from lumbar.base.errors import InputError


def refusal(action, *given, **how) -> str:
    """Do what is refused; return what is said."""
    with pytest.raises(InputError) as caught:
        action(*given, **how)
    return str(caught.value)
