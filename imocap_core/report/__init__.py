"""The report of an action: tables, figures and one page.

The stage evaluate writes tables and figures into the folder `report/`:

Reading order:
    action_report       the report of a run: its page is written when the run's results differ from
                        those it shows
    table_files         the report's files for programs, tables as CSV and JSON, and their columns
                        in words
    page                the report's page: HTML with embedded pictures, and Markdown that links them
    sections            order of the report: its sections, with their pictures, tables and
                        introductions
    write_page          stored results to the page and its figures; imported only when a page is
                        written
    tables              scores and artifacts to the report's tables
    uncertainty_tables  how far results can be trusted: standard deviations, observability,
                        synchronisation
    evaluation          all tables and figures of the stage evaluate, in the order of the report
"""
