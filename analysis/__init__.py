"""What the runs say: errors against the truth, statistics over trials, tables and figures."""
