# tissue
