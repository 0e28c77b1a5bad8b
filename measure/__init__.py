"""Joins the stages: arrays and records in, records out, no files and no printing."""
