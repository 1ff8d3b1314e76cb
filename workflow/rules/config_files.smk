# The default study's files, read once before Snakemake reads them: it names neither file nor line of a fault.

import sys
from pathlib import Path

sys.path.insert(0, str(Path(workflow.basedir) / "workflow"))

from lumbar.base.yaml_file import check_readable
from lumbar.base.errors import LumbarError

try:
    check_readable(Path(workflow.basedir), ["config/config.yaml", "config/twin.yaml"])
except LumbarError as error:
    sys.exit(str(error))  # a WorkflowError would begin with this file and line, where nothing is wrong
