# stability
