"""Bodies of requests and responses as pydantic models, which the OpenAPI document shows."""
