"""Spectra of surgeons' motion (Welch), and design of excitation signals."""
