"""What every chapter can be told: one frozen dataclass per section of a configuration, with the one definition of each default."""
