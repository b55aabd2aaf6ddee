"""One function a metric; `docs/metrics.md` says in words what each of them means."""
