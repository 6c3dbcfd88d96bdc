"""What tests share: small worlds, made-up results, references, and ways to look at what is made."""
