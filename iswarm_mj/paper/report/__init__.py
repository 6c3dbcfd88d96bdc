"""Everything that is made of results: findings, the report, tables on pages, descriptions."""
