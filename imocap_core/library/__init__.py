"""Everything that the command line does, as functions; `import imocap` is the page of these."""
