"""Names of the files that the report's page is written to."""

PAGE, TEXT = "report.html", "report.md"
