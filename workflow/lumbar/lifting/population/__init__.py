"""Statistics of people: several persons, several trials of each, groups and boxes compared."""
