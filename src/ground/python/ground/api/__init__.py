"""What `import ground` gives: one module for each verb, beside the models, rooms and recordings."""
