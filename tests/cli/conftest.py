"""The toy pipeline of tests/pipeline, for the commands."""

from tests.pipeline.conftest import toy  # noqa: F401  (a fixture)
