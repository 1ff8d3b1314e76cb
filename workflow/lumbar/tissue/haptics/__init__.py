"""Models in a person's hand: passivity, stability and simulation of the loop of model, hold, device and hand."""
