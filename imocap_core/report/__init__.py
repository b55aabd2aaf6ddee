"""The report of an action: tables, figures and one page."""
