"""Which rule takes what another makes, for all that a study makes: the same whatever a run is asked for."""

from __future__ import annotations

from snakemake.iocontainers import Wildcards
from snakemake.output_index import OutputIndex


def rule_graph(workflow, target: str, alike: set[str] = frozenset()) -> list[list[str]]:
    """Return the graph of rules of a target: which makes, which uses; sorted, each pair once.

    Parameters
    ----------
    workflow : snakemake.workflow.Workflow
        With all its rules.
    target : str
        Rule whose inputs are followed to what makes them, and so on.
    alike : set of str
        Wildcards whose values are all made by the same rules: one of them is followed.
    """
    index = OutputIndex(workflow.rules)
    edges, seen = set(), set()
    pending = [(workflow.get_rule(target), {})]
    while pending:
        rule, wildcards = pending.pop()
        for file in rule.expand_input(Wildcards(fromdict=wildcards))[0]:
            for maker in index.match_producers(file):
                edges.add((maker.name, rule.name))
                values = maker.get_wildcards(file)
                job = (maker.name, *sorted(item for item in values.items() if item[0] not in alike))
                if job not in seen:
                    seen.add(job)
                    pending.append((maker, values))
    return sorted(map(list, edges))
