export async function diagnoseRoom(place) { place.append(document.createTextNode("diagnose")); }
