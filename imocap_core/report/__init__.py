"""What people look at: figures, film, tables, and the report that holds them."""
