"""Pictures without what takes longest in them, for tests of anything but the look of a picture."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock


@contextmanager
def sketched() -> Iterator[None]:
    """Let Matplotlib neither solve constrained layouts nor write more of a PDF file than its first bytes."""
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    with (
        mock.patch.object(ConstrainedLayoutEngine, "execute", lambda engine, figure: None),
        mock.patch.object(
            FigureCanvasPdf, "print_pdf", lambda canvas, path, **options: path.write_bytes(b"%PDF-")
        ),
    ):
        yield
