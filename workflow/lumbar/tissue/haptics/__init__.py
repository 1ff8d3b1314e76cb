"""Models on a haptic device in a hand: passivity, stability and simulation of the loop of model, hold, device and hand."""
