"""Loaded by MkDocs before it reads the sources."""

import griffe

# In `skiros2_common.core`, the decorator `@property` would be taken for the module `property`.
griffe.builtin_decorators["skiros2_common.core.property"] = "property"
