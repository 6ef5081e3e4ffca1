"""What is on disk and how it is read and written: configuration files, models, taught views, runs."""
