"""Other people's methods, implemented to be compared with; the pipeline never uses them."""
