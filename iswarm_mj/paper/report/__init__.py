"""The report on all results, and what is made of them: findings, tables on pages, the results themselves."""
