"""The one way from photo to verdict: captures and records in, records out, and no printing."""
