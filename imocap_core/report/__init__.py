"""The report of an action: tables, figures and one page.

The stage evaluate writes tables and figures into the folder `report/`:

    evaluation_tables     all its tables, of
      tables              scores, rounds, videos
      hand_tables, trust_tables, event_table, uncertainty_tables, observability_text
    evaluation_figures    its plots and contact sheets
    files                 tables as files (by table_text), and contents.json

At the end of a run:

    action_report         whether the page shows these results already; if not:
    write_page            stored results to the page
    page_figures          its further figures
    sections              which table and figure belongs to which section
    page                  the page as HTML and Markdown, with metric_glossary, column_titles,
                          table_markup and page_style
"""
