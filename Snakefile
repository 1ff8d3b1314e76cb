# From recordings to every table, figure and FMU of the thesis, in the thesis's order.
#
#   snakemake --cores 2                                                     the default study
#   snakemake --cores 2 --configfile config/studies/<study>.yaml            another laboratory
#   snakemake --cores 2 stability --configfile config/subjects/<name>.yaml  one person alone
#   snakemake --cores 2 table_3_1                                           one artefact

from snakemake.utils import min_version

min_version("9.12.0")


include: "workflow/rules/config_files.smk"


configfile: str(ROOT / "config/config.yaml")
configfile: str(ROOT / "config/twin.yaml")


include: "workflow/rules/common.smk"
include: "workflow/rules/records.smk"
include: "workflow/rules/twin.smk"
include: "workflow/rules/surgeon.smk"
include: "workflow/rules/signals.smk"
include: "workflow/rules/tissue.smk"
include: "workflow/rules/improvement.smk"
include: "workflow/rules/runtime.smk"
include: "workflow/rules/survey.smk"
include: "workflow/rules/lifting.smk"
include: "workflow/rules/stability.smk"
include: "workflow/rules/population.smk"
include: "workflow/rules/claims.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/targets.smk"


rule all:
    default_target: True
    input:
        made(ARTEFACTS),
        # A cohort's page reads every recording once more: it is made when asked for.
        [] if study.has("population") else rules.report_page.output.page,
    message:
        f"Study {STUDY}: everything is made"
