"""Sharp pictures from blurred ones and a known kernel."""
