"""What goes over the wire as JSON, as pydantic models."""
