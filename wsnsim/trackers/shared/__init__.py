"""What several strategies share: parcels, readings, stacked clouds, moving flocks, moments, dealing."""
