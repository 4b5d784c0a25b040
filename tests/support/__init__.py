"""What several tests share: small demonstrations, toy environments, services."""
