"""A team's own recordings: CSV files, ROS bags, PyFG factor graphs or MRCLAM text, read into one form, `TeamLog`."""
