"""Objects of JSON that commands write: each key with its type, its unit and its meaning.

The functions that write them are checked against these types; docs/reference/json.md is made from them.
"""
