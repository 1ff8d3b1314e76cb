"""What many scripts import, imported once: processes that are forked from one with these libraries start with them.

Only libraries of others: the project's own is read by every job anew, as it stands when the job starts.
"""

import gc
from importlib import import_module

for name in (
    "snakemake.cli",  # of the run's main module, which a forked process imports again
    "snakemake.iocontainers",
    "pandas.io.formats.csvs",
    "scipy.integrate",
    "scipy.interpolate",
    "scipy.optimize",
    "scipy.signal",
    "scipy.stats",
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
    "bokeh.embed",
    "bokeh.plotting",
    "fontTools.subset",
    "jinja2",
    "pydantic.dataclasses",
    "clarabel",
):
    import_module(name)

gc.freeze()  # what no collection touches stays shared memory
