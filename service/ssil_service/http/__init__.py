"""What every request passes before its route: middleware, limits, and the OpenAPI document."""
