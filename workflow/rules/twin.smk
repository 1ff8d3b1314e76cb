# twin
