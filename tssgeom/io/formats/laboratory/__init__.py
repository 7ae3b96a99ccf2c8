"""Tables as laboratories write them: text of any separator, spreadsheets, arrays; their names and units."""
