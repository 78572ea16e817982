"""What was found, in words, pictures and pages."""
