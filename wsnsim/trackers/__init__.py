"""One tracking strategy a file, and what several of them share: parcels, readings, stacks, moments, dealing."""
