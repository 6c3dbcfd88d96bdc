"""How many runs are carried out: jobs, pools, journals, searches."""
