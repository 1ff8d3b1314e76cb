"""Records of the pages' tests, and their diagnosis."""

import pytest

import lumbar
from lumbar.twin import examples


@pytest.fixture(scope="session")
def example_records():
    """Return a periodic record and another one of a tissue with dry friction, 50 Hz, noise of 0.01 N."""
    return examples.example_records()


@pytest.fixture(scope="session")
def diagnosis(example_records):
    settings = lumbar.StudySettings(improvement=lumbar.ImprovementSettings(most_effects=1))
    return lumbar.diagnose(
        example_records, settings=settings, source_label="a lab </script><script>alert(1)</script>"
    )


@pytest.fixture(scope="session")
def page(diagnosis):
    return diagnosis.page()
