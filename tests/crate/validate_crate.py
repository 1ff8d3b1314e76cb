"""Validate an archive with rocrate-validator against the profile Workflow Run Crate, without the internet.

Runs in an environment that has ``roc-validator``: ``python validate_crate.py ARCHIVE``. Prints every requirement that is not
met, and ends with status 1 where one is REQUIRED. In place of the two context documents, which the validator would fetch, stand
those of their terms that may be used; another term is an error, as one would be that the documents lack.
"""

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

from rdflib.plugins.shared.jsonld import context as jsonld
from rocrate_validator import services
from rocrate_validator.utils.http import HttpRequester

SCHEMA = Path(__file__).with_name("schema_terms.txt").read_text(encoding="utf-8").split()
CONTEXTS = {
    "https://w3id.org/ro/crate/1.1/context": {
        **{term: f"http://schema.org/{term}" for term in SCHEMA},
        "File": "http://schema.org/MediaObject",
        "ComputationalWorkflow": "https://bioschemas.org/ComputationalWorkflow",
        "conformsTo": "http://purl.org/dc/terms/conformsTo",
    },
    "https://w3id.org/ro/terms/workflow-run/context": {
        term: f"https://w3id.org/ro/terms/workflow-run#{term}" for term in ("sha256", "environment")
    },
}


def answer(requester, url: str, **kwargs) -> SimpleNamespace:
    """Answer as the web would for the contexts."""
    document = {"@context": CONTEXTS[str(url)]}
    headers = {"Content-Type": "application/ld+json"}
    return SimpleNamespace(status_code=200, headers=headers, json=lambda: document, text=json.dumps(document))


def main(archive: str) -> int:
    """Validate; return the exit status."""
    settings = {
        "rocrate_uri": archive,
        "profile_identifier": "workflow-run-crate",
        "requirement_severity": "RECOMMENDED",
        "skip_availability_check": True,
        "disable_remote_crate_download": True,
    }
    local = jsonld.source_to_json

    def source_to_json(source, *arguments, **options):
        if str(source) in CONTEXTS:
            return {"@context": CONTEXTS[str(source)]}, None
        return local(source, *arguments, **options)

    with (
        mock.patch.object(jsonld, "source_to_json", source_to_json),
        mock.patch.object(HttpRequester, "get", answer, create=True),
    ):
        result = services.validate(settings)
    for issue in result.get_issues():
        print(f"{issue.severity.name}: {issue.check.identifier}: {issue.message} ({issue.violatingEntity})")
    return int(any(issue.severity.name == "REQUIRED" for issue in result.get_issues()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
