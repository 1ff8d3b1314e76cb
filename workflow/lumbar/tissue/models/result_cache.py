"""Cache of results that an object's data and few parameters determine."""

from collections.abc import Callable, Hashable
from typing import Any

import numpy as np

_MAX_LATEST = 8  # results of different parameters


class ResultCache:
    """Cache, owned by an object, of results that were computed from its data, e.g. forces on a motion."""

    def __init__(self) -> None:
        self._latest: dict[tuple[Hashable, bytes], Any] = {}
        self._lasting: dict[Hashable, Any] = {}

    def compute_at(self, name: Hashable, nonlinear: np.ndarray, compute: Callable[[], Any]) -> Any:
        """Return the result of `compute`, cached for the latest few nonlinear parameters: fits change one at a time.

        Parameters
        ----------
        name : hashable
            Name of the result, unique in the cache.
        nonlinear : numpy.ndarray, shape (nonlinear parameters,)
            Parameters on which the result depends.
        compute : callable
            Function without arguments that computes the result.
        """
        key = name, np.asarray(nonlinear, dtype=float).tobytes()
        result = self._latest.pop(key) if key in self._latest else compute()
        self._latest[key] = result
        if len(self._latest) > _MAX_LATEST:
            del self._latest[next(iter(self._latest))]
        return result

    def compute_once(self, name: Hashable, compute: Callable[[], Any]) -> Any:
        """Return the result of `compute`, cached for the lifetime of the object; it depends on no parameters.

        Parameters
        ----------
        name : hashable
            Name of the result, unique in the cache.
        compute : callable
            Function without arguments that computes the result.
        """
        if name not in self._lasting:
            self._lasting[name] = compute()
        return self._lasting[name]
