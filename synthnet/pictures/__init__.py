"""Pictures of meshes, eigenfunctions and whole datasets, drawn without a display."""
