"""What every chapter can be told: a frozen dataclass per section, with the one definition of each default."""
