"""The public formats: pages, tables, schemas, vectors, reference decoder."""
