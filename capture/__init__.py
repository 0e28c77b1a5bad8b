"""From camera files to records: raw decoding, chart detection, patch statistics."""
