"""Oriental Motor AZ drives on RS-485, Modbus RTU."""
