"""Signal processing that estimators and deconvolution share."""
