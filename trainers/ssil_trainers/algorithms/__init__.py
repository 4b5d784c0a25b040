"""GAIL, MixGAIL, SSIL and behavior cloning; no environment is imported here."""
