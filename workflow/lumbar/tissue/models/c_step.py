"""C code of a form: what it does at one sample, for models that run where there is no Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

Constants = Callable[[Mapping[str, float], float], dict[str, float]]
Memory = Callable[[Mapping[str, float]], int]


def _no_constants(parameters: Mapping[str, float], sampling_time: float) -> dict[str, float]:
    return {}


@dataclass(frozen=True)
class CStep:
    """One sample of a form in C99.

    The code becomes the body of a function. It knows by name

    - the form's linear and nonlinear parameters and what `constants` adds to them;
    - the motion that reaches the form: ``time``, ``position``, ``step`` (change of position since the sample before),
      ``velocity``, ``acceleration``, ``path``, and ``first``, true at the first sample. Derivatives are backward
      differences, for a running loop knows no later sample;
    - in output forms ``force``, which is to be transformed;
    - with `history`, ``earlier(now, ring, n)``, the position that reached the form n samples ago, 0 to `history`;
    - with `memory`, ``memory[i]`` as the sample before left it, 0 at the start, and ``next[i]``, to be written;
    - the functions of ``effect_forms.h`` and ``portable_math.h``: ``sign``, ``clipped``, ``behind_gap``,
      ``portable_tanh`` … Those of the C library that are exact (``fabs``, ``sqrt``, ``floor`` …) may be used too; the
      others are refused, because they differ between platforms in the last bit.
    """

    value: str
    """Expression: the force that a parallel form adds, the position that an input form passes on, the force that an output
    form makes of ``force``."""
    statements: str = ""
    """What comes before it."""
    memory: int | Memory = 0
    """How many numbers the form keeps from sample to sample; a callable gets all parameters by name."""
    constants: Constants = _no_constants
    """From parameters by name and the sampling time in seconds to further numbers by name, computed at export.
    One named ``pole`` is a pole in discrete time and counts when stability is judged."""
    history: int | Memory = 0
    """How many earlier positions it asks for; a callable as of `memory`."""

    def numbers(self, parameters: Mapping[str, float], sampling_time: float) -> dict[str, float]:
        """All numbers that the code knows by name.

        Raises
        ------
        ValueError
            If a constant has the name of a parameter.
        """
        constants = self.constants(parameters, sampling_time)
        if taken := sorted(constants.keys() & parameters.keys()):
            raise ValueError(f"constants have names of parameters: {', '.join(taken)}")
        return {**parameters, **constants}

    def memory_size(self, numbers: Mapping[str, float]) -> int:
        """How many numbers the form keeps, given those that its code knows."""
        return self.memory(numbers) if callable(self.memory) else self.memory

    def history_size(self, numbers: Mapping[str, float]) -> int:
        """How many earlier positions it asks for, given the numbers that its code knows."""
        return self.history(numbers) if callable(self.history) else self.history
