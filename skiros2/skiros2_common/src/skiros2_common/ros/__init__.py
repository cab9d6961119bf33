"""What the platform's nodes share: wire formats, logging, start-up."""
