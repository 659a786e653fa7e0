"""The solver in the form that other libraries have: a file a library, none imported for another."""
