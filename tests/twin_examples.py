"""Recordings of the synthetic twin, for tests that use only ``lumbar`` itself."""

from lumbar.twin.examples import example_lift, example_records

__all__ = ["example_lift", "example_records"]
