"""Reading: a file and a mapping give a Recording, or one sentence that says why not."""
