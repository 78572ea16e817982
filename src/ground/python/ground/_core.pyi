# The compiled core, for programs that check types: what it has is not described.
from typing import Any

def __getattr__(name: str) -> Any: ...
