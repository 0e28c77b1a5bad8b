"""A ledger of whole measurements: what the product gives on a fixed set of captures, with errors.

``make ledger`` measures it again and compares it, case by case, with what is recorded.
"""
