"""What the commands print: lists, progress, results, the contents of a run, and what is made of finished runs."""
