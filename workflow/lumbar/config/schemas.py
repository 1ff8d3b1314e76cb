"""A configuration against its JSON schemas: all wrong keys and values at once."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path

from lumbar.errors import Problems


@cache
def _schemas(root: Path):
    """Registry of all schemas in ``workflow/schemas``, and the validator of the whole configuration."""
    import yaml
    from jsonschema import Draft202012Validator
    from referencing import Registry, Resource

    folder = root / "workflow" / "schemas"
    contents = {
        path.name: yaml.safe_load(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.yaml"))
    }
    registry = Registry().with_resources(
        (name, Resource.from_contents({"$schema": "https://json-schema.org/draft/2020-12/schema", **content}))
        for name, content in contents.items()
    )
    return lambda name: Draft202012Validator(contents[name], registry=registry)


def check_schema(content: dict, root: Path, problems: Problems, schema: str = "config.schema.yaml") -> None:
    """Add every wrong key and value of `content` to `problems`."""
    from jsonschema.exceptions import best_match

    errors = _schemas(root)(schema).iter_errors(content)
    for error in sorted(errors, key=lambda item: list(map(str, item.path))):
        if error.validator in ("anyOf", "oneOf") and error.context:
            error = best_match([error])
        key = ".".join(map(str, error.absolute_path)) or "top level"
        allowed = error.schema.get("description", "") if isinstance(error.schema, dict) else ""
        if error.validator == "additionalProperties":
            known = ", ".join(error.schema.get("properties", {}))
            problems.add(key, error.message.split(" (")[0], f"allowed keys: {known}. {error.message}")
        else:
            problems.add(key, error.message, allowed)


def check_sections(content: dict, sections: Iterable[str], root: Path) -> None:
    """Check some sections of a configuration against their schemas.

    Parameters
    ----------
    content : dict
        By section; a section's schema is ``workflow/schemas/<section>.schema.yaml``.
    sections : iterable of str
        Those to check.
    root : Path
        Folder of the project.

    Raises
    ------
    InputError
        With every wrong key and value.
    """
    problems = Problems("configuration")
    for section in sections:
        own = Problems(section)
        check_schema(content[section], root, own, f"{section}.schema.yaml")
        problems.extend(own)
    problems.raise_if_any()
