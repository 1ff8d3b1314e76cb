# Folder of the workflow, also if another workflow imports it, and its default files: Snakemake's own message for a fault in
# them names neither file nor line.

import sys
from pathlib import Path

ROOT = Path(workflow.snakefile).resolve().parents[2]
WORKFLOW = ROOT / "workflow"
if not WORKFLOW.is_dir():
    sys.exit(
        "lumbar: a module takes the path of the Snakefile in a clone, because its jobs import workflow/lumbar"
    )
sys.path.insert(0, str(WORKFLOW))

from lumbar.base.yaml_file import check_readable
from lumbar.base.errors import LumbarError
from lumbar.study.load_study import DEFAULT_FILES

try:
    check_readable(ROOT, DEFAULT_FILES)
except LumbarError as error:
    sys.exit(str(error))  # a WorkflowError would begin with this file and line, where nothing is wrong
