"""A craft finds its own physics: it flies, is diagnosed, and flies again, until nothing is missing."""
