"""Engines: the same few verbs over different physics back ends."""
