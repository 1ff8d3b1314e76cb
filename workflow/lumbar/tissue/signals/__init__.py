"""Surgeon motion (Welch) and excitation signals."""
