"""Clients, each tried for real: `examples` run as they are, `table` says what they need, `page` is made of the runs."""
